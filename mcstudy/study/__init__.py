"""Studies: the study file, the Dask graph, the Zarr cube."""

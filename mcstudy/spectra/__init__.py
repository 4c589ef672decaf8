"""From a recording to FRFs with covariance: periods, lines, bands."""

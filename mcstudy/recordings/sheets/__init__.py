"""Descriptions of recordings and of groups as TOML files: what each may state, as strict tables."""

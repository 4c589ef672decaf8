"""The tables of `mcstudy show`, as data and as text."""

"""Groups of simulated people whose differences have known causes, from the shipped example."""

from __future__ import annotations

from examples import module

people = module("group_differences").people

"""The study of Goodworth & Peterka (2018): its published numbers, solver and lost table, attached to mcstudy."""

import os

from mcstudy import program

program.attach(__name__, os.path.dirname(os.path.realpath(__file__)))

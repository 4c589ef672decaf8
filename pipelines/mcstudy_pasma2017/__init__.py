"""The sensitivity analysis of Pasma et al. (2017): its statements about the independent-channel model of stance."""

import os

from mcstudy import program

program.attach(__name__, os.path.dirname(os.path.realpath(__file__)))

"""The benchmark of the diagnosis: recordings with hidden causes, answers and scores, attached to mcstudy."""

import os

from mcstudy import program

program.attach(__name__, os.path.dirname(os.path.realpath(__file__)))

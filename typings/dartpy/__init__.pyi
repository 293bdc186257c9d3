"""Covers what equipoise uses of dartpy 6.20."""

from dartpy import collision as collision
from dartpy import common as common
from dartpy import constraint as constraint
from dartpy import dynamics as dynamics
from dartpy import math as math
from dartpy import simulation as simulation
from dartpy import utils as utils

__version__: str

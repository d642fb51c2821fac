"""Kahraman & Singh (1991): the spur pair on shafts and bearings with clearances of their own.

A. Kahraman, R. Singh, "Non-linear dynamics of a geared rotor-bearing system with multiple clearances", J. Sound Vib.
144(3) (1991) 469-506: three degrees of freedom. The model is that of the paper as `GearRotorBearing` writes it; the
case computed here is our own, chosen so that bearings lose contact as well, and is compared with time integration.
"""

"""Many designs: tolerances and their effect.

One response curve for each of many parameter sets, which scatter due to manufacturing and operation: distribution of
peaks and jumps, and the effect of each parameter.
"""

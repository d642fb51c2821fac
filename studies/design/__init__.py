"""Many designs: tolerances and their effect.

One response curve for each of many parameter sets, as manufacturing and operation scatter them: what is certain about
a peak or a jump, and which parameter decides it.
"""

"""Dong et al. (2022): the marine double-helical gear pair, figure by figure.

H. Dong, Y. Bi, B. Wen, Z. Liu, L. Wang, "Bending-torsional-axial-pendular nonlinear dynamic modeling and frequency
response analysis of a marine double-helical gear drive system considering backlash", J. Low Freq. Noise Vib. Act.
Control 41(2) (2022) 519-539. The studies have the numbers of its figures. The docstring of `DoubleHelicalPair` states
the choices where the paper is not specific; the table of readings shows the effect of other choices, and a search over
three of them finds readings that hold all statements on Figures 3 and 4.
"""

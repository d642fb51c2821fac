"""Random machines: what the toolkit says of them, held against the truth.

Machines of four kinds drawn at random, wide of what is usual and with extremes among them: spur pairs, double-helical
pairs of 24 degrees of freedom, pairs on shafts and bearings with clearance, and two masses with one or two elements
(stops, clearances, cubic springs) in any direction; and of fifteen further kinds. Each is traced with the default call.
"""

"""Random machines: results compared with shooting and time integration.

Machines of four kinds drawn at random from wide ranges, including extreme ones: spur pairs, double-helical
pairs of 24 degrees of freedom, pairs on shafts and bearings with clearance, and two masses with one or two elements
(stops, clearances, cubic springs) in any direction; and of fifteen further kinds. Each is traced with the default call.
"""

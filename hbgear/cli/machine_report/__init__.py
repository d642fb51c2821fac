"""Report on a machine: its gears, speeds, subharmonic motions and assumptions."""

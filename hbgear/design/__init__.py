"""Many designs: samples, studies on all cores, their store."""

"""Many designs: samples, parallel evaluation, store."""

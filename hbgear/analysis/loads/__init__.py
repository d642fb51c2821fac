"""Loads of gears along a branch: sharing between planets, forces and root stresses of pairs of teeth."""

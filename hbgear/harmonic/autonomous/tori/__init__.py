"""Tori: quasi-periodic motions with the frequency of the excitation and a second, unknown one."""

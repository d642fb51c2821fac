"""Figures of response curves, motions, jump maps, sweeps, basins and studies; the package that imports matplotlib.

Every function takes a result, draws it on matplotlib axes, new ones by default, and returns the axes.

Examples
--------
>>> import hbgear as hb
>>> curve = hb.trace(hb.HarmonicBalance(hb.Duffing(), 5), "Omega", (0.5, 1.6))
>>> hb.plot.save(hb.plot.response(curve), "curve.png")  # doctest: +SKIP
"""

from typing import TYPE_CHECKING

from hbgear.common import lazy_names as _late

if TYPE_CHECKING:  # imported when they are first used
    from hbgear.plot.curves import response, responses, speed_axes
    from hbgear.plot.designs.bands import band
    from hbgear.plot.designs.effects import tornado
    from hbgear.plot.designs.fits import fitted, measured
    from hbgear.plot.designs.parameter_planes import jump_map, special_curves
    from hbgear.plot.designs.study import (
        JUMPS,
        PERCENTILES,
        against_parameters,
        envelope,
        figures,
        jump_distribution,
        percentiles,
    )
    from hbgear.plot.free_motions import backbone, torus, torus_section, torus_spectrum
    from hbgear.plot.machines.mesh import drive, mesh_cycles
    from hbgear.plot.machines.rotors import campbell
    from hbgear.plot.machines.teeth import harris_map, tooth_loads
    from hbgear.plot.machines.trains import load_sharing, planetary, train
    from hbgear.plot.motions import FLOOR, phase_diagram, portrait, spectrum, time_history
    from hbgear.plot.simulations.attractors import VERDICTS, bifurcation_diagram
    from hbgear.plot.simulations.simulation import (
        BASINS,
        DIRECTIONS,
        INKS,
        REFINED,
        SYMBOLS,
        basins,
        bifurcation,
        sweeps,
        validation,
    )
    from hbgear.plot.style import (
        BRANCHES,
        COLOURS,
        FONT,
        GREY,
        LINES,
        MARKERS,
        STYLE,
        WIDTHS,
        State,
        in_style,
        legend_entry,
        save,
    )
    from hbgear.plot.sweep_paths import RUNS, orders, runs, waterfall

__all__ = [
    "BASINS",
    "BRANCHES",
    "COLOURS",
    "DIRECTIONS",
    "FLOOR",
    "FONT",
    "GREY",
    "INKS",
    "JUMPS",
    "LINES",
    "MARKERS",
    "PERCENTILES",
    "REFINED",
    "RUNS",
    "STYLE",
    "SYMBOLS",
    "VERDICTS",
    "WIDTHS",
    "State",
    "against_parameters",
    "backbone",
    "band",
    "basins",
    "bifurcation",
    "bifurcation_diagram",
    "campbell",
    "drive",
    "envelope",
    "figures",
    "fitted",
    "harris_map",
    "in_style",
    "jump_distribution",
    "jump_map",
    "legend_entry",
    "load_sharing",
    "measured",
    "mesh_cycles",
    "orders",
    "percentiles",
    "phase_diagram",
    "planetary",
    "portrait",
    "response",
    "responses",
    "runs",
    "save",
    "special_curves",
    "spectrum",
    "speed_axes",
    "sweeps",
    "time_history",
    "tooth_loads",
    "tornado",
    "torus",
    "torus_section",
    "torus_spectrum",
    "train",
    "validation",
    "waterfall",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = _late.attached(__name__)

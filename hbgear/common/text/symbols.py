r"""Axis labels of models in other forms than the TeX of Matplotlib: plain text for tables, HTML for pages.

The label ``damping ratio $\zeta_p$`` becomes the text "damping ratio ζ_p" and the HTML "damping ratio ζ<sub>p</sub>".
"""

from __future__ import annotations

import html
import re
import unicodedata

_SCRIPT = re.compile(r"([_^])(?:\{([^{}]*)\}|(\S))")
_COMMAND = re.compile(r"\\([A-Za-z]+)(?: +(?=[\w}]))?")
_WRITTEN = {"dot": "\u0307", "prime": "\N{PRIME}", "times": "\N{MULTIPLICATION SIGN}", "cdot": "\N{DOT OPERATOR}"}


def in_text(label: str) -> str:
    r"""Return a label as plain text.

    >>> in_text(r"$\Omega = \omega_\mathrm{mesh}/\omega_n$ [-]"), in_text(r"$I_p$ [kg m$^2$]")
    ('Ω = ω_mesh/ω_n [-]', 'I_p [kg m^2]')
    """
    return _SCRIPT.sub(lambda found: found[1] + (found[2] or found[3] or ""), _letters(label))


def in_html(label: str) -> str:
    r"""Return a label as HTML with escaped characters.

    >>> in_html(r"$k_{p\theta x}$ [N m/rad], x < 1")
    'k<sub>pθx</sub> [N m/rad], x &lt; 1'
    """
    tags = {"_": "sub", "^": "sup"}

    def scripted(found: re.Match[str]) -> str:
        return f"<{tags[found[1]]}>{found[2] or found[3] or ''}</{tags[found[1]]}>"

    parts = label.split("$")  # every second part is a formula; outside formulas an underscore is part of a name
    return "".join(
        _SCRIPT.sub(scripted, html.escape(_letters(part))) if i % 2 else html.escape(part)
        for i, part in enumerate(parts)
    )


def unit_of(label: str) -> str:
    r"""Return the unit at the end of a label: "1" for [-], empty if the label has no unit.

    >>> unit_of(r"$I_p$ [kg m$^2$]"), unit_of(r"$x$ [-]"), unit_of(r"damping ratio $\zeta$")
    ('kg m^2', '1', '')
    """
    found = re.search(r"\[([^\[\]]*)\]\s*$", in_text(label))
    return "" if found is None else "1" if found[1] == "-" else found[1]


def shown_unit(label: str) -> str:
    r"""Return the unit of a label as `unit_of`, empty for numbers without a dimension.

    >>> shown_unit("torque [N m]"), shown_unit(r"$\zeta$ [-]")
    ('N m', '')
    """
    unit = unit_of(label)
    return "" if unit == "1" else unit


def without_unit(label: str) -> str:
    """Return a label as plain text without the unit at its end."""
    return re.sub(r"\s*\[[^\[\]]*\]\s*$", "", in_text(label))


def _letters(label: str) -> str:
    """Return a label with Greek letters instead of TeX commands; braces remain around scripts of several letters."""
    label = re.sub(r"\\(?:mathrm|text|mathit|mathbf)\{([^{}]*)\}", r"{\1}", label)
    label = _COMMAND.sub(_letter, label.replace("$", ""))
    return re.sub(r"(?<![_^])\{([^{}]*)\}", r"\1", label)


def _letter(found: re.Match[str]) -> str:
    """Return the character of a TeX command, or its name."""
    name = found[1]
    if name in _WRITTEN:
        return _WRITTEN[name]
    size = "CAPITAL" if name[0].isupper() else "SMALL"
    try:
        return unicodedata.lookup(f"GREEK {size} LETTER {_SPELT.get(name, name.removeprefix('var')).upper()}")
    except KeyError:
        return name


_SPELT = {"lambda": "lamda", "Lambda": "lamda"}  # spelling in Unicode

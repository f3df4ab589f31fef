"""An effect file from a formula: what ``--add-effect`` takes as it is, and a person can go on from."""

from __future__ import annotations

from diagnosis.document import Formula, FormulaTerm, UnknownEffect
from diagnosis.report.words import joints_in_short

FILE = "unknown_effect.py"
BEYOND = 3.0
"""A coefficient may become so many times what was fitted."""

WORDS = (
    *(("torque_nm", "τ"), ("abs(v)", "|v|"), ("abs(τ)", "|τ|"), ("smooth_sign", "sign")),
    *(("q * q * q", "q³"), ("q * q", "q²"), ("v * v", "v²"), (" * ", "·")),
)
"""How code reads, in turn."""

TEMPLATE = '''"""What no effect of the library explains at {joints}: {text}

Written by a diagnosis. It predicts {percent:.0f} % of what was left, in runs that it was not fitted to. To try it:

    PYTHONPATH=FOLDER spot-rl diagnose LOGS --nominal MODEL --out OTHER --add-effect unknown_effect:UnknownTorque
"""

from dataclasses import dataclass
from typing import Any, ClassVar

from array_api_compat import array_namespace

from spot_model.effects.base import TorqueEffect, parameter
from spot_model.effects.friction import smooth_sign  # noqa: F401 - not every formula needs it


@dataclass(frozen=True, kw_only=True)
class UnknownTorque(TorqueEffect):
    """{text}"""

    name: ClassVar[str] = "unknown_torque"
{parameters}

    def torque(self, torque_nm, motion, memory):
        """The torque with what the formula adds."""
        xp = array_namespace(torque_nm)  # noqa: F841
        q, v = motion.position_rad, motion.velocity_rad_s
        return torque_nm + {added}, memory
'''


def effect_source(unknown: UnknownEffect) -> str | None:
    """The file's text, or None where no formula was found."""
    formula = unknown.formula
    if formula is None:
        return None
    parameters, added = [], []
    for i, term in enumerate(formula.terms, start=1):
        bound = BEYOND * max(abs(term.value), 1e-6)
        parameters.append(_parameter(f"c{i}", 0.0, -bound, bound, term.unit, f"{term.value:.4g} fitted to logs"))
        code = term.code
        if term.at_rad is not None and term.width_rad is not None:
            at, width = term.at_rad, term.width_rad
            parameters.append(_parameter(f"at{i}_rad", at, at - 2 * width, at + 2 * width, "rad", "fitted to logs"))
            parameters.append(_parameter(f"width{i}_rad", width, 0.5 * width, 1.5 * width, "rad", "fitted to logs"))
            code = code.replace("at_rad", f"self.at{i}_rad").replace("width_rad", f"self.width{i}_rad")
        added.append(f"self.c{i} * {code}")
    return TEMPLATE.format(
        joints=joints_in_short(unknown.joints),
        text=formula_text(formula),
        percent=100.0 * formula.predicted_share,
        parameters="\n".join(parameters),
        added=" + ".join(added),
    )


def formula_text(formula: Formula) -> str:
    """For a person: ``Δτ = −4.1·q − 2.0 N·m``."""
    told = "Δτ ="
    for i, term in enumerate(formula.terms):
        sign = "−" if term.value < 0.0 else "+"
        told += f" {sign} " if i else (" −" if term.value < 0.0 else " ")
        told += f"{abs(term.value):.3g} {term.unit}{_words(term)}"
    return told


def _words(term: FormulaTerm) -> str:
    code = term.code
    for written, read in WORDS:
        code = code.replace(written, read)
    if term.at_rad is not None and term.width_rad is not None:
        code = f"exp(−((q − {term.at_rad:.3g} rad)/{term.width_rad:.2g} rad)²)" + ("·sign(v)" if "sign" in code else "")
    return "" if code == "1.0" else f"·{code}"


def _parameter(name: str, null: float, low: float, high: float, unit: str, source: str) -> str:
    bounds = f"null={null:.6g}, low={low:.6g}, high={high:.6g}"
    return f"    {name}: Any = parameter({bounds}, unit={unit!r}, source={source!r})"

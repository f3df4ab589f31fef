"""A formula for what no effect explains: the few terms of a dictionary that predict it in runs they were not fitted to.

Sparse regression: orthogonal matching pursuit over terms in a joint's angle, speed and torque, each term smoothed as
the channel is. What ordinary errors can stand for is taken off both sides first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import orth
from scipy.optimize import minimize
from sklearn.linear_model import orthogonal_mp_gram

from diagnosis.channels import Array, Channel, Flags
from diagnosis.channels.actuator import ActuatorSignals
from diagnosis.document import Formula, FormulaTerm
from diagnosis.selection.evidence import Evidence
from spot_model.effects.friction import smooth_sign

MAX_TERMS: Final = 3
MIN_SHARE: Final = 0.25
"""A formula that predicts less of what is left, in runs that it was not fitted to, is none."""
MIN_MORE: Final = 0.04
"""One more term predicts at least this share more."""
N_CENTRES: Final = 25
WIDTHS_RAD: Final = (0.05, 0.1, 0.2)
WIDEST_RAD: Final = 0.4
RANK: Final = 1e-3
"""Directions of the ordinary errors with less than this share of the strongest are rounding."""


class Samples(NamedTuple):
    """Angle (rad), speed (rad/s) and torque (N·m) of all joints, each of shape (N, J)."""

    q: Array
    v: Array
    torque_nm: Array


@dataclass(frozen=True)
class Term:
    """One term with its code, in the names of :class:`spot_model.effects.base.Motion`; ``place`` is what it sits at."""

    code: str
    unit: str
    values: Callable[[Samples], Array]
    place: tuple[float, float] | None = None
    """Centre and width of a bump, rad."""


def _plain() -> list[Term]:
    return [
        Term("1.0", "N·m", lambda m: np.ones_like(m.q)),
        Term("q", "N·m/rad", lambda m: m.q),
        Term("q * q", "N·m/rad²", lambda m: m.q * m.q),
        Term("q * q * q", "N·m/rad³", lambda m: m.q**3),
        Term("v * abs(v)", "N·m·s²/rad²", lambda m: m.v * abs(m.v)),
        Term("v * v", "N·m·s²/rad²", lambda m: m.v * m.v),
        Term("q * v", "N·m·s/rad²", lambda m: m.q * m.v),
        Term("q * smooth_sign(v)", "N·m/rad", lambda m: m.q * smooth_sign(m.v)),
        Term("torque_nm * q", "1/rad", lambda m: m.torque_nm * m.q),
        Term("torque_nm * abs(torque_nm)", "1/(N·m)", lambda m: m.torque_nm * abs(m.torque_nm)),
        Term("torque_nm * abs(v)", "s/rad", lambda m: m.torque_nm * abs(m.v)),
        Term("abs(torque_nm) * smooth_sign(v)", "1", lambda m: abs(m.torque_nm) * smooth_sign(m.v)),
    ]


def bump(centre_rad: float, width_rad: float, *, rubs: bool) -> Term:
    """A torque about one angle; one that rubs opposes the motion."""

    def values(m: Samples) -> Array:
        near = np.exp(-(((m.q - centre_rad) / width_rad) ** 2))
        return np.asarray(near * smooth_sign(m.v) if rubs else near)

    code = "xp.exp(-(((q - at_rad) / width_rad) ** 2))" + (" * smooth_sign(v)" if rubs else "")
    return Term(code, "N·m", values, (centre_rad, width_rad))


class _Columns:
    """Terms and residuals of the joints that carry the unknown, without what ordinary errors stand for."""

    def __init__(self, board: Evidence, residuals: Sequence[Array], numbers: Sequence[int]) -> None:
        self.s: ActuatorSignals = board.views[Channel.SET_POINT_TO_LOAD].signals
        self.blocks = [board.blocks[n] for n in numbers]
        self._ordinary = [orth(board.ordinary.x[n] * board.blocks[n].weight[:, None], RANK) for n in numbers]
        self.y = self._joined([residuals[n] for n in numbers])
        self.fold = np.concatenate([b.fold for b in self.blocks])
        self.angle_rad = np.concatenate([self.s.position_rad[self.s.kept][b.samples, b.row] for b in self.blocks])

    def of(self, term: Term) -> Array:
        """A term's column in units of the noise, shape (m,)."""
        s = self.s
        finished = s.finish(term.values(Samples(s.position_rad, s.velocity_rad_s, s.torque_nm)))
        return self._joined([b.cleaned(finished[b.samples, b.row]) for b in self.blocks])

    def _joined(self, parts: Sequence[Array]) -> Array:
        weighted = [part * b.weight for part, b in zip(parts, self.blocks, strict=True)]
        return np.concatenate([x - z @ (z.T @ x) for x, z in zip(weighted, self._ordinary, strict=True)])


def find_formula(board: Evidence, residuals: Sequence[Array], joints: Flags) -> Formula | None:
    """The formula of the torque that is missing or too much, or None where no short one predicts it.

    Residuals by block, in units of the noise; ``joints`` where the unknown effect acts, shape (J,).
    """
    carrying = board.by_channel.get(Channel.SET_POINT_TO_LOAD, [])
    numbers = [n for n in carrying if joints[board.views[Channel.SET_POINT_TO_LOAD].row_joint[board.blocks[n].row]]]
    if not numbers:
        return None
    columns = _Columns(board, residuals, numbers)
    centres = np.quantile(columns.angle_rad, np.linspace(0.02, 0.98, N_CENTRES))
    terms = [*_plain(), *(bump(float(c), w, rubs=r) for c in centres for w in WIDTHS_RAD for r in (True, False))]
    x = np.stack([columns.of(term) for term in terms], axis=1)
    chosen: list[Term] = []
    share = 0.0
    for size in range(1, MAX_TERMS + 1):
        more = [_moved(columns, terms[k]) for k in _pursued(x, columns.y, size)]
        told = _held_out(np.stack([columns.of(term) for term in more], axis=1), columns.y, columns.fold)
        if told < share + (MIN_MORE if chosen else MIN_SHARE):
            break
        chosen, share = more, told
    if not chosen:
        return None
    fitted = np.linalg.lstsq(np.stack([columns.of(t) for t in chosen], axis=1), columns.y, rcond=None)[0]
    found = []
    for term, size in zip(chosen, fitted.tolist(), strict=True):
        at, width = term.place or (None, None)
        found.append(FormulaTerm(code=term.code, unit=term.unit, value=size, at_rad=at, width_rad=width))
    return Formula(terms=tuple(found), predicted_share=share)


def _pursued(x: Array, y: Array, size: int) -> list[int]:
    """Numbers of the columns that orthogonal matching pursuit takes."""
    scale = np.sqrt(np.sum(x**2, axis=0)) + 1e-12
    unit = x / scale
    found = orthogonal_mp_gram(unit.T @ unit, unit.T @ y, n_nonzero_coefs=size)
    return [int(k) for k in np.flatnonzero(found)]


def _moved(columns: _Columns, term: Term) -> Term:
    """A bump moved to where it explains most by itself; other terms as they are."""
    if term.place is None:
        return term
    low, high = columns.angle_rad.min(), columns.angle_rad.max()
    rubs, start = "smooth_sign" in term.code, np.array(term.place)

    def left(at: Array) -> float:
        if not (low <= at[0] <= high and 0.02 <= at[1] <= WIDEST_RAD):
            return float(np.inf)
        x = columns.of(bump(float(at[0]), float(at[1]), rubs=rubs))
        return -float((x @ columns.y) ** 2 / max(float(x @ x), 1e-12))

    simplex = np.array([start, start + np.array([0.05, 0.0]), start * np.array([1.0, 1.5])])
    best = minimize(left, start, method="Nelder-Mead", options={"maxfev": 40, "initial_simplex": simplex}).x
    return bump(float(best[0]), float(best[1]), rubs=rubs)


def _held_out(x: Array, y: Array, fold: Array) -> float:
    """Share of the square that the columns predict in folds that they were not fitted to."""
    error = 0.0
    for f in np.unique(fold):
        test = fold == f
        size = np.linalg.lstsq(x[~test], y[~test], rcond=None)[0]
        error += float(np.sum((y[test] - x[test] @ size) ** 2))
    return 1.0 - error / max(float(np.sum(y**2)), 1e-12)

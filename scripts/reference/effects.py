"""docs/reference/effects.md: every effect, as it acts and as it looks."""

from __future__ import annotations

import inspect
import textwrap
from pathlib import Path

from diagnosis.channels.channel import CHANNEL_TITLES
from diagnosis.library.registry import LIBRARY
from spot_model.effects.base import Effect, Hook
from spot_model.effects.registry import BUILT_IN

from .words import page, plain, table

HOOKS = {
    Hook.MODEL: ("edit", "The physics model, once, before the first step"),
    Hook.TORQUE: ("torque", "The motor torque, at every physics step"),
    Hook.SOFTWARE: ("setpoint_rad", "The set-point that the program sends"),
    Hook.COMMAND: ("arrival_s", "The way of a command from the policy to the servos"),
    Hook.SENSOR: ("read", "What the joints' sensors report"),
    Hook.ESTIMATE: ("estimate", "What the state estimator reports of the body"),
}
PICTURES = Path(__file__).resolve().parents[2] / "docs" / "reference" / "effects"
ABOUT = """\
An *effect* is a physical phenomenon that a simulator may lack: friction, a limit, a delay, backlash. These effects
are built in, and shared by the fake robot, identification, diagnosis and training. In a [model file](files.md) an
effect is one line:

```yaml
- {effect: coulomb_friction, joints: [knees], level_nm: 0.4}
```

`joints` takes joint names (`fl_hx` … `hr_kn`), `hips`, `knees`, `all`, or a leg (`fl`, `fr`, `hl`, `hr`). At its
*null* value a parameter has no influence at all. *Looks like* describes the effect in a log and the channels of the
diagnosis that show it; *confused with* lists effects that look similar, and *told apart by* the recording that
distinguishes them. Each picture shows the front left knee over 0.6 s of walking in the paper's identified model,
without (grey) and with the effect (red), from the same start. To write your own, see [add an
effect](../add-an-effect.md)."""


def effects_page() -> str:
    """The page."""
    rows = []
    for name, cls in sorted(BUILT_IN.items()):
        rows.append((f"[`{name}`](#{name})", _title(name), cls.hook.value, ", ".join(p.unit for p in cls.parameters())))
    parts = [table(("effect", "what it is", "hook", "units"), rows)]
    for hook, (_, about) in HOOKS.items():
        found = sorted((n, c) for n, c in BUILT_IN.items() if c.hook is hook)
        if found:
            parts += [f"\n## Hook: {hook.value}\n\n{about}.\n", *(section(name, cls) for name, cls in found)]
    return page("Effects", ABOUT, parts)


def section(name: str, cls: type[Effect]) -> str:
    """One effect."""
    told, _, source = plain(cls.__doc__ or "").partition("Source:")
    parameters = table(
        ("parameter", "unit", "null", "range", "source"),
        [(f"`{p.name}`", p.unit, f"{p.null:g}", f"{p.low:g} to {p.high:g}", p.source) for p in cls.parameters()],
    )
    lines = [f"### {name}", f"*{_title(name).capitalize()}.* {told.strip()}"]
    if (PICTURES / f"{name}.svg").is_file():
        lines.append(f"![{name}: a knee without and with it](effects/{name}.svg)")
    lines += [parameters.rstrip(), _look(name)]
    if source:
        lines.append(f"Source: {' '.join(source.split())}")
    method = HOOKS[cls.hook][0]
    code = textwrap.dedent(inspect.getsource(getattr(cls, method))).rstrip()
    lines.append(
        f"<details markdown='1'><summary>The formula, as it runs</summary>\n\n```python\n{code}\n```\n\n</details>"
    )
    return "\n\n".join(line for line in lines if line) + "\n"


def _title(name: str) -> str:
    return LIBRARY[name].title if name in LIBRARY else name.replace("_", " ")


def _look(name: str) -> str:
    if name not in LIBRARY:
        return "Not in the diagnosis' library."
    entry = LIBRARY[name]
    channels = ", ".join(f"{CHANNEL_TITLES[c]} (`{c}`)" for c in entry.channels)
    others = ", ".join(f"[{_title(n)}](#{n})" for n in entry.confused_with) or "nothing"
    looks = " ".join(plain(entry.__doc__ or "").split())
    told = f"*Looks like*: {looks} Shows in: {channels}.\n\n*Confused with*: {others}."
    return f"{told} *Told apart by*: {entry.split_by.text}"

"""docs/scenario.md: every key of a fake robot's scenario."""

from __future__ import annotations

from fake_robot.scenario.scenario import Scenario, shipped_names

from .words import page, sections

ABOUT = """\
What makes one fake robot what it is: what it hides (`model`, [effects](reference/effects.md) that no program is told
of), its ground, payload, channels, sensors, clock, battery, and what it refuses. A YAML file, `--scenario FILE` of
`spot-rl fake-robot`. Every key may be left out; an unknown one is refused.

```yaml
schema: spot-rl/scenario/1
terrain: {friction: 0.4}
payload: {mass_kg: 5}
```"""


def scenario_page() -> str:
    """The page."""
    shipped = ", ".join(f"`{name}`" for name in shipped_names())
    return page(
        "The fake robot's scenario", f"{ABOUT}\n\n`--scenario NAME` takes a shipped one: {shipped}.", sections(Scenario)
    )

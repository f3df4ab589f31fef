"""Hide dry friction in the fake robot's knees, walk it, and let the diagnosis find it: the picture of the README.

    python examples/hidden_friction.py hidden_friction

Under ten minutes on two cores. The simulator knows the robot's rotor inertia, and nothing of the friction.
"""

from __future__ import annotations

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import spot_rl
from spot_model.io.model_file import save_model

POLICY = "walk"
HIDDEN_NM = 5.0
WALKS = ((0.4, 0.0, 0.0), (0.9, 0.0, 0.0), (0.5, 0.0, 0.6))
REPEATS = 3
ROTORS = (
    {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": 0.0403},
    {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": 0.0731},
)


def main(out: Path) -> None:
    """Walk, diagnose, and say what was found."""
    nominal = spot_rl.load_model("paper_identified", effects=ROTORS)
    friction = {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": HIDDEN_NM}
    hidden = spot_rl.load_model("paper_identified", effects=[friction])
    with spot_rl.FakeSpot(model=hidden) as spot:
        for velocity in WALKS:
            for repeat in range(REPEATS):
                run = spot.walk(POLICY, velocity=velocity, duration_s=6.0, log_dir=out / "logs")
                print(f"walked at {velocity}, repeat {repeat + 1} of {REPEATS}: {run.outcome}")
    save_model(nominal, out / "nominal.yaml")
    verdict = spot_rl.diagnose(out / "logs", out / "nominal.yaml", out / "gap", policy=POLICY, progress=True)
    print(verdict.headline)
    for found in verdict.differences:
        numbers = ", ".join(f"{n} {p.value:.2f} ({p.low:.2f} to {p.high:.2f})" for n, p in found.parameters.items())
        print(f"{found.title} at {', '.join(found.joints)}: {numbers}; P {found.probability:.2f}")
    print(f"hidden: {HIDDEN_NM:g} N·m in the knees; {verdict.status}; page {out / 'gap' / 'report.html'}")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, default=Path("hidden_friction"), help="folder of logs and page")
    main(parser.parse_args().out)

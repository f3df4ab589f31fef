"""What a policy's contract says of its gait, in one sentence."""

from __future__ import annotations

from spot_model.policy.contract import PolicyContract
from spot_model.robot.gait import HOPS


def gait_sentence(contract: PolicyContract) -> str:
    """What the contract says of the gait, speeds of one name together; a warning where the policy hops."""
    if not contract.gait:
        return (
            f"policy {contract.name} states no gait: nobody measured whether it trots or hops; "
            "spot-rl evaluate measures it, spot-rl export writes it into the file"
        )
    spans: list[tuple[str, float, float]] = []
    for stated in contract.gait:
        if spans and spans[-1][0] == stated.name:
            spans[-1] = (stated.name, spans[-1][1], stated.v_x_m_s)
        else:
            spans.append((stated.name, stated.v_x_m_s, stated.v_x_m_s))
    told = ", ".join(f"{name} at {_speeds(low, high)}" for name, low, high in spans)
    hops = sorted({name for name, *_ in spans} & HOPS)
    if not hops:
        return f"policy {contract.name}, measured in simulation at export: {told}"
    return (
        f"warning: policy {contract.name} hops ({' and '.join(hops)}): {told}. The feet of a pair leave the ground "
        "together, which is hard on a robot's legs and on what it carries; a trot is what the policies here do"
    )


def _speeds(low: float, high: float) -> str:
    return f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"

"""What to record next to tell two effects apart: a velocity sequence, gains and conditions that can be collected."""

from __future__ import annotations

from dataclasses import dataclass

from spot_model.io.velocity_sequence import VelocitySequence, forward_sequence, sequence_of, standing_sequence


@dataclass(frozen=True)
class Experiment:
    """One more recording."""

    name: str
    text: str
    """What to do and why it tells, one sentence for a person."""
    sequence: VelocitySequence
    kp_nm_per_rad: float | None = None
    """Servo stiffness for this recording; None for the policy's own."""
    kd_nm_s_per_rad: float | None = None
    by_hand: str = ""
    """What a person must do besides: payload, surface, attitude."""


_TURNS = ((0, 0, 0, 0), (1, 0.8, 0, 0), (7, 0, 0.5, 0), (11, 0, 0, 1.0), (15, -0.6, 0, 0), (19, 0, 0, 0))
WALK = sequence_of("walk_and_turn", 20.0, *_TURNS)

OTHER_KD = Experiment(
    "other_damping",
    "Walk again with kd 1.0: a change of kd scales with kd, friction does not.",
    WALK,
    kd_nm_s_per_rad=1.0,
)
OTHER_KP = Experiment(
    "other_stiffness",
    "Walk again with kp 50: a wrong stiffness scales with kp, a torque gain with all torque.",
    WALK,
    kp_nm_per_rad=50.0,
)
SLOW_WALK = Experiment(
    "slow_walk",
    "Walk slowly: what acts near standstill grows, what needs speed vanishes.",
    sequence_of("slow_walk", 20.0, (0, 0, 0, 0), (1, 0.2, 0, 0), (10, -0.2, 0, 0), (19, 0, 0, 0)),
)
SPRINT = Experiment(
    "sprint", "Run up to 4 m/s: limits of torque, speed and power act only there.", forward_sequence(4.0)
)
LOADED_WALK = Experiment(
    "loaded_walk",
    "Walk with a known payload: load-dependent friction grows, plain friction does not.",
    WALK,
    by_hand="fix a known mass of 5 kg or more to the middle of the back",
)
STAND = Experiment("stand", "Stand still: loads alone must carry the known weight.", standing_sequence())
LONG_WALK = Experiment(
    "long_walk",
    "Walk for two minutes: heat grows with time, a gain does not.",
    sequence_of("long_walk", 120.0, (0, 0, 0, 0), (1, 1.0, 0, 0), (119, 0, 0, 0)),
)
TURN = Experiment(
    "turn_in_place",
    "Turn in place by half a turn: a tilted floor turns with the heading, a tilted sensor does not.",
    sequence_of("turn_in_place", 20.0, (0, 0, 0, 0), (2, 0, 0, 1.0), (9, 0, 0, -1.0), (16, 0, 0, 0)),
)
MIRROR = Experiment(
    "mirrored_sideways",
    "Step left, then right: what belongs to one side changes sides.",
    sequence_of("mirrored_sideways", 20.0, (0, 0, 0, 0), (1, 0, 0.8, 0), (10, 0, -0.8, 0), (19, 0, 0, 0)),
)
OTHER_GROUND = Experiment(
    "other_ground",
    "Walk on hard, grippy ground: what belongs to the ground changes, the robot does not.",
    WALK,
    by_hand="repeat on bare concrete or rubber flooring",
)
TAPED_DISTANCE = Experiment(
    "taped_distance",
    "Walk along a taped line and compare the odometry with its length.",
    WALK,
    by_hand="mark start and end of the walk and measure the distance",
)
WIRED_LINK = Experiment(
    "wired_link",
    "Repeat over a cable: what belongs to the link changes.",
    WALK,
    by_hand="connect by Ethernet in place of wireless",
)

"""docs/reference/conformance.md: what a robot may refuse."""

from __future__ import annotations

from fake_robot.conformance.command import markdown

from .words import page

ABOUT = """\
Every check that the fake robot makes on a client, and every answer that a client may rely on, with its source. The
fake robot refuses everything that a robot may refuse according to the protos. Undocumented behaviour is marked *our
guess*; the last column names the key of the [scenario](scenario.md) that changes the fake robot's answer.

The same checks can be run against any server that claims to be a Spot:

```sh
spot-rl fake-robot exec -- spot-rl fake-robot conformance --robot HOST
```

It logs in with `BOSDYN_CLIENT_USERNAME` and `BOSDYN_CLIENT_PASSWORD`, and never takes a lease that another client
holds. A host that may be a real robot needs `--i-stand-beside-it`: stand beside it with its e-stop in your hand.

Without `--with-motion` it sends nothing that could give the motors power. Some commands must be refused by a robot
without power. They are sent only if the state says that the motors are off, and if the robot has refused a stop
(which moves nothing) for want of power. Where the two contradict each other, the suite has the robot sit down and
switches its motors off. Then it goes on if the legs carry nothing. The motors are looked at before the first check and
after each. If they have power that they had not, the suite has the robot sit down and switches them off, says so, and
sends nothing more.

`--with-motion` also asks for power without a lease. Then it powers the motors, stands, leans, and walks for 4 s in a
turn to the left and 0.5 m ahead. If joint control is licensed, it holds the stance with the gains of the robot's own
stand, with steps of some hundredths of a radian about it. It lets the last command end without a successor, upon
which a robot may sink to the ground. Then it sits and powers off. A step that fails leaves the others their turn.
Leave it 3 m on each side. Ctrl-C and SIGTERM have it sit down and power off first. No check presses an e-stop, so
none shows that one stops the robot.

| exit code | meaning |
|---|---|
| 0 | no rule is broken in what was judged |
| 1 | a documented or measured rule is broken |
| 3 | something that was asked for could not be judged; the lines marked *open* say why |
| 4 | motors had power that they should not have had: unasked, or after they were switched off |

Where the server only contradicts a guess, the result is *differs*. What the server does not offer, and what needs
`--with-motion`, is *skipped*."""


def conformance_page() -> str:
    """The page."""
    return page("What a robot may refuse", ABOUT, [markdown()])

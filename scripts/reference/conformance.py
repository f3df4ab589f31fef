"""docs/conformance.md: what a robot may refuse."""

from __future__ import annotations

from fake_robot.conformance.table import markdown

from .words import page

ABOUT = """\
Every check that the fake robot makes on a client, and every answer that a client may rely on, with its source. The
fake robot refuses everything that a robot may refuse according to the protos. Undocumented behaviour is marked *our
guess*; the last column names the key of the [scenario](scenario.md) that changes the fake robot's answer.

The same checks can be run against any server that claims to be a Spot:

```sh
spot-rl fake-robot exec -- spot-rl fake-robot conformance --robot HOST
```

It logs in with `BOSDYN_CLIENT_USERNAME` and `BOSDYN_CLIENT_PASSWORD`, moves nothing, and never takes a lease that
another client holds. `--with-motion` also powers the motors, stands, walks half a metre and sits. A host that may be a
real robot needs `--i-stand-beside-it`: stand beside it with its e-stop in your hand. The exit code is 1 if a documented
or measured rule is broken; where the server only contradicts a guess, the result is *differs*."""


def conformance_page() -> str:
    """The page."""
    return page("What a robot may refuse", ABOUT, [markdown()])

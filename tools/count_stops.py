"""Count the stops of one clip on its way through `actioncli classify`, from command to decision.

A function of the package counts once, however often it is called between the command and the
decision. Properties, lambdas, comprehensions and constructors do not count. Two figures are
printed:

*called*: all of these functions, what loads the weights and the support set included.

*chain*: those that hand the clip on. They take its path, recording, clip or comparison, or from
another file its frames or embeddings, and return the next of these forms, or call a function
that does. The layers inside the two calls of a network, `embed` and `scores`, are none.

    python tools/count_stops.py [CLIP]
"""

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from typer.testing import CliRunner

from actioncli import Clip, Comparison, Decision
from actioncli.cli.app import app
from actioncli.clips.recording import Recording

EXAMPLES = Path(__file__).parents[1] / "examples"
CLIP = Path(sys.argv[1]) if len(sys.argv) > 1 else EXAMPLES / "wave_right/cleo.npz"
FIRST, LAST = ("actioncli.cli.classify", "classify"), ("actioncli.recognition.decision", "decide")
# Functions in the order of their first call, and whether they hand the clip on.
stops: dict[tuple[str, str], bool] = {}
arrays: list[Any] = []
carriers: dict[FrameType, tuple[str, str]] = {}


def forms(value: Any, arrays_from: int) -> list[Any]:
    """The forms of the clip that a value is or holds; arrays from so many dimensions on."""
    if isinstance(value, Mapping | list | tuple):
        inside = value.values() if isinstance(value, Mapping) else value
        return [form for each in inside for form in forms(each, arrays_from)]
    typed = isinstance(value, Recording | Clip | Comparison | Decision)
    path = isinstance(value, Path) and value == CLIP
    return [value] * (
        typed or path or (isinstance(value, np.ndarray) and value.ndim >= arrays_from)
    )


def watch(frame: FrameType, event: str, value: Any) -> None:
    """See `sys.setprofile`."""
    code, module = frame.f_code, frame.f_globals.get("__name__", "")
    function = module, code.co_qualname
    caller = frame.f_back.f_globals.get("__name__", "") if frame.f_back else ""
    if not module.startswith("actioncli.") or not (stops or function == FIRST) or stops.get(LAST):
        return
    layer = all(name.startswith("actioncli.model.") for name in (module, caller))
    of = type(frame.f_locals.get("self"))
    if layer or code.co_name[0] == "<" or isinstance(getattr(of, code.co_name, None), property):
        return
    if event == "call":
        stops.setdefault(function, False)
        given = forms(list(frame.f_locals.values()), arrays_from=3 if module != caller else 99)
        if any(
            not isinstance(one, np.ndarray) or any(one is each for each in arrays) for one in given
        ):
            carriers[frame] = function
    elif event == "return" and frame in carriers:
        made = forms(value, arrays_from=2)
        arrays.extend(made)
        above: FrameType | None = frame if made else None
        while above is not None:
            if above in carriers:
                stops[carriers[above]] = True
            above = above.f_back


with tempfile.TemporaryDirectory() as folder:
    store = ["--store", f"{folder}/support.db"]
    CliRunner().invoke(app, ["enroll", "wave", str(EXAMPLES / "wave_right/ada.npz"), *store])
    sys.setprofile(watch)
    CliRunner().invoke(app, ["classify", str(CLIP), "--json", *store])
    sys.setprofile(None)
chain = [function for function, hands_on in stops.items() if hands_on]
print(*(f"{module}: {name}" for module, name in chain), sep="\n")
for what, found in (("called", list(stops)), ("chain", chain)):
    print(f"{what}: {len(found)} functions in {len({module for module, _ in found})} files")

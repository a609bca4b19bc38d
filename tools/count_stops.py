"""Count the stops of one clip on its way through `actioncli classify`, from command to decision.

A function of the package counts once, however often it is called until the decision is there;
properties, lambdas, comprehensions and constructors do not. *called* are all of these functions,
what loads weights and support set included. *chain* are those that hand the clip on: they take
its path, recording, clip or comparison, or from another file its frames or embeddings, and return
the next of these forms, or call a function that does. The layers of a network are none.
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
CLIP = EXAMPLES / "wave_right/cleo.npz"
FIRST, LAST = ("actioncli.cli.classify", "classify"), ("actioncli.recognition.decision", "decide")
stops: dict[tuple[str, str], bool] = {}  # functions as they are called: whether they hand it on
carriers: dict[FrameType, tuple[str, str]] = {}
arrays: list[Any] = []


def forms(value: Any, dimensions: int) -> list[Any]:
    """The forms of the clip that a value is or holds; arrays from so many dimensions on."""
    if isinstance(value, Mapping | list | tuple):
        inside = value.values() if isinstance(value, Mapping) else value
        return [form for each in inside for form in forms(each, dimensions)]
    typed = isinstance(value, Recording | Clip | Comparison | Decision)
    array = isinstance(value, np.ndarray) and value.ndim >= dimensions
    return [value] * (typed or array or (isinstance(value, Path) and value == CLIP))


def watch(frame: FrameType, event: str, value: Any) -> None:
    """See `sys.setprofile`."""
    code, module = frame.f_code, frame.f_globals.get("__name__", "")
    caller = frame.f_back.f_globals.get("__name__", "") if frame.f_back else ""
    function, of = (module, code.co_qualname), type(frame.f_locals.get("self"))
    outside = not module.startswith("actioncli.") or not (stops or function == FIRST)
    layer = module.startswith("actioncli.model.") and caller.startswith("actioncli.model.")
    unnamed = code.co_name[0] == "<" or isinstance(getattr(of, code.co_name, None), property)
    if outside or layer or unnamed or stops.get(LAST):
        return
    if event == "call":
        stops.setdefault(function, False)
        given = forms(list(frame.f_locals.values()), 99 if module == caller else 3)
        if any(not isinstance(one, np.ndarray) or id(one) in map(id, arrays) for one in given):
            carriers[frame] = function
    elif event == "return" and frame in carriers and forms(value, 2):
        arrays.extend(forms(value, 2))
        above: FrameType | None = frame
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

"""Make the store of today's schema that later releases must be able to open.

Run it before a new migration is added, and commit what it writes:

    python tests/store/schemas/make.py

`v<schema>.db` holds examples of three actions, a negative with the embedding that the shipped
weights gave it, and a calibrated threshold; `v<schema>.json` says what is in it. A file that is
there already is kept: it is what the release of its time wrote.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

from actioncli import Clip, Recognizer, SupportStore, read_clip
from actioncli.recognition.threshold import Threshold, keep_threshold
from actioncli.store.migrations import MIGRATIONS

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[2] / "examples"


def example(name: str, step: int) -> Clip:
    """Every `step`-th frame of an example clip, so that the store stays small."""
    clip = read_clip(EXAMPLES / f"{name}.npz")
    return Clip(clip.joints[::step], clip.joint_names, clip.fps / step, source=clip.source)


def main() -> None:
    """Write the store and its description."""
    path = HERE / f"v{len(MIGRATIONS)}.db"
    if path.exists():
        sys.exit(f"{path} is there already; it is never made anew.")
    store = SupportStore(path)
    store.enroll("removed", example("bow/ben", 5))
    store.enroll_all([("wave", example("wave_right/ada", 3))], note="by the window")
    store.enroll_all(
        [("squat", example("squat/ada", 3)), ("winken – 手", example("wave_left/ada", 3))]
    )
    store.enroll("squat", example("squat/ben", 4))
    store.enroll("noise", example("punch_right/dev", 3), negative=True)
    store.remove("removed")
    store.rename("winken – 手", "winken – 手 (links)")
    recognizer = Recognizer()
    weights = recognizer.weights.checksum
    # Those of one example are enough, and small.
    (noise,) = store.examples("noise")
    store.keep_embeddings(weights, {noise.id: recognizer.embed([store.clip(noise.id)])[0]})
    keep_threshold(store, Threshold(0.375, weights, {"squat": 0.625}))
    told = {
        "schema": len(MIGRATIONS),
        "examples": [asdict(each) for each in store.examples()],
        "threshold": json.loads(store.setting("threshold") or "null"),
    }
    text = json.dumps(told, ensure_ascii=False, indent=1)
    path.with_suffix(".json").write_text(text + "\n", "utf-8")


if __name__ == "__main__":
    main()

"""doctor."""

import json
from pathlib import Path

from actioncli import SupportStore, __version__

from .conftest import Invoke


def test_a_whole_installation(invoke: Invoke, filled: SupportStore) -> None:
    result = invoke("doctor", "--json")
    told = json.loads(result.stdout)
    assert (result.exit_code, told["ok"], result.stderr) == (0, True, "")
    found = {check["name"]: check for check in told["checks"]}
    assert found["actioncli"]["detail"] == __version__
    assert found["enrolled"]["detail"] == "5 actions, 5 examples"
    assert str(filled.path) in found["support set"]["detail"]
    assert found["weights"]["status"] == found["recognition"]["status"] == "ok"
    assert found["pose_detector.onnx"]["detail"].endswith("intact")
    assert "numpy" in invoke("doctor").stdout
    assert invoke("doctor", "-q").output == ""


def test_no_support_set_yet_is_no_problem(invoke: Invoke, home: Path) -> None:
    assert invoke("doctor").exit_code == 0
    assert not home.exists()


def test_problems_have_the_codes_of_their_errors(
    invoke: Invoke, store: SupportStore, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.db"
    broken.write_text("no database" * 100)
    weights = tmp_path / "damaged.safetensors"
    weights.write_bytes(b"no weights")
    for words, code, part in (
        (["--store", broken], 5, "support set"),
        (["--weights", weights], 6, "weights"),
        (["--store", broken, "--weights", weights], 6, "weights"),
    ):
        result = invoke("doctor", "--json", *words)
        assert result.exit_code == code
        told = json.loads(result.stdout)
        assert not told["ok"]
        assert part in [c["name"] for c in told["checks"] if c["status"] == "problem"]
        assert result.stderr.startswith("error: ")
        # Everything else is still looked at.
        assert len(told["checks"]) > 10

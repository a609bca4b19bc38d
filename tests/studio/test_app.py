"""What the studio's page can ask for."""

import errno
import http.client
import threading
import time
from pathlib import Path

import pytest

from actioncli import SupportStore, read_clip
from actioncli.recognition.threshold import Threshold, keep_threshold, kept_threshold
from actioncli.studio.app import LARGEST_UPLOAD, Studio

from .serving import EXAMPLES, Client, until

SQUAT, WAVE = EXAMPLES / "squat/ada.npz", EXAMPLES / "wave_right/ada.npz"


def left_behind(studio: Studio) -> list[Path]:
    return list(studio.upload_folder.folder.iterdir())


def nothing_left(studio: Studio) -> None:
    """What ends a request ends it in its own time."""
    until(lambda: not left_behind(studio))


def test_enrolled_classified_and_rejected_as_the_commands_do(
    client: Client, studio: Studio
) -> None:
    first = client.send(SQUAT)
    assert first["decision"] is None
    assert first["frames"] == len(read_clip(SQUAT))
    assert any("unit inferred" in note for note in first["notes"])
    client.enroll(SQUAT, "squat")
    client.enroll(WAVE, "wave")
    accepted = client.send(EXAMPLES / "squat/ben.npz")["decision"]
    assert (accepted["label"], accepted["accepted"]) == ("squat", True)
    store = studio.actions.store
    same = studio.actions.recognizer.classify(
        read_clip(EXAMPLES / "squat/ben.npz"), store.support()
    )
    assert accepted["confidence"] == pytest.approx(same.confidence, abs=1e-6)
    rejected = client.send(EXAMPLES / "bow/ben.npz")["decision"]
    assert (rejected["label"], rejected["accepted"]) == (None, False)
    assert [e.source for e in store.examples("squat")] == ["ada.npz"]
    nothing_left(studio)


def test_the_same_clip_is_known_and_an_unlike_one_is_told(client: Client) -> None:
    assert client.enroll(SQUAT, "squat")["added"]
    again = client.enroll(SQUAT, "squat")
    assert (again["added"], again["warnings"]) == (False, [])
    warning, threshold = client.enroll(WAVE, "squat")["warnings"]
    assert threshold.startswith("tau is ")
    assert warning.startswith("unlike the other examples of `squat`")


def test_negatives_shadow_and_have_a_place_of_their_own(client: Client) -> None:
    client.enroll(SQUAT, "squat")
    client.enroll(EXAMPLES / "squat/ben.npz", "", negative=True)
    decision = client.send(EXAMPLES / "squat/ben.npz")["decision"]
    assert decision["negative_is_nearer"]
    assert not decision["accepted"]
    actions = client.get("/api/state")["actions"]
    assert {action["label"]: action["negative"] for action in actions} == {
        "squat": False,
        "negatives": True,
    }


def test_a_state_that_is_known_is_not_told_again(client: Client, studio: Studio) -> None:
    client.enroll(SQUAT, "squat")
    state = client.get("/api/state")
    assert client.get(f"/api/state?version={state['version']}") == {"version": state["version"]}
    # Somebody else, at the same time.
    SupportStore(studio.actions.store.path).enroll("wave", read_clip(WAVE))
    changed = client.get(f"/api/state?version={state['version']}")
    assert [action["label"] for action in changed["actions"]] == ["squat", "wave"]
    assert client.send(EXAMPLES / "wave_right/ben.npz")["decision"]["label"] == "wave"


def test_removed_and_renamed(client: Client, studio: Studio) -> None:
    client.enroll(SQUAT, "squat")
    client.enroll(EXAMPLES / "squat/ben.npz", "squat")
    client.enroll(WAVE, "wave")
    example = client.get("/api/state")["actions"][0]["examples"][0]
    assert client.get(f"/api/examples/{example['id']}")["joints"] >= 15
    path = f"/api/examples/{example['id']}"
    assert client.ask("DELETE", path, {"label": "wave"})[0] == 404
    assert client.ask("DELETE", path, {"label": "squat"}) == (200, {"removed": 1})
    assert client.ask("GET", path)[0] == 404
    assert client.ask("PATCH", "/api/actions", {"label": "squat", "new": "sit"})[0] == 200
    status, answer = client.ask("PATCH", "/api/actions", {"label": "sit", "new": "wave"})
    assert (status, "enrolled already" in answer["error"]["message"]) == (400, True)
    assert client.ask("DELETE", "/api/actions", {"label": "wave"}) == (200, {"removed": 1})
    assert [action.label for action in studio.actions.store.actions()] == ["sit"]


def test_exported_as_one_file(client: Client, studio: Studio, tmp_path: Path) -> None:
    assert client.ask("GET", "/api/export")[0] == 404
    client.enroll(SQUAT, "squat")
    status, _, content = client.answer("GET", "/api/export")
    assert status == 200
    file = tmp_path / "actions.safetensors"
    file.write_bytes(content)
    assert SupportStore(tmp_path / "other.db").import_(file) == (1, 0)
    nothing_left(studio)


def test_false_accepts_and_rejects_over_tau(client: Client, studio: Studio) -> None:
    assert client.get("/api/measurement") == {"state": "nothing"}
    for name, label in (("squat/ada", "squat"), ("squat/ben", "squat"), ("wave_right/ada", "wave")):
        client.enroll(EXAMPLES / f"{name}.npz", label)
    answer = client.get("/api/measurement")
    while answer["state"] == "measuring":
        assert 0 <= answer["share"] < 1
        time.sleep(0.05)
        answer = client.get("/api/measurement")
    accepts = [rate["false_accepts"]["count"] for rate in answer["rates"]]
    rejects = [rate["false_rejects"]["count"] for rate in answer["rates"]]
    assert len(accepts) == 101
    assert accepts == sorted(accepts, reverse=True)
    assert rejects == sorted(rejects)
    assert (accepts[100], rejects[0], rejects[100]) == (0, 0, 2)
    assert answer["rates"][50]["false_rejects"]["of"] == 2
    assert any("one example" in note for note in answer["notes"])
    # A threshold that is kept changes the store, and nothing that was measured.
    client.ask("PUT", "/api/tau", {"tau": 0.7})
    assert client.get("/api/measurement") == answer


def test_a_kept_tau_is_that_of_the_commands(client: Client, studio: Studio) -> None:
    client.enroll(SQUAT, "squat")
    checksum, store = studio.actions.recognizer.weights.checksum, studio.actions.store
    assert client.ask("PUT", "/api/tau", {"tau": 0.62})[0] == 200
    assert kept_threshold(store) == Threshold(0.62, checksum)
    state = client.get("/api/state")
    assert (state["tau"], state["kept"]) == (0.62, True)
    assert client.send(WAVE)["decision"]["tau"] == 0.62
    client.ask("PUT", "/api/tau", {"tau": None})
    assert kept_threshold(store) is None
    keep_threshold(store, Threshold(0.4, checksum, {"squat": 0.9}))
    assert client.get("/api/state")["own"] == 1
    assert client.send(SQUAT)["decision"]["tau"] == 0.9
    keep_threshold(store, Threshold(0.9, "other weights"))
    assert client.get("/api/state")["tau"] == 0.5
    for wrong in (1.5, -0.1, "0.5", [], True):
        assert client.ask("PUT", "/api/tau", {"tau": wrong})[0] == 400


def test_clips_that_came_along(client: Client) -> None:
    for action, performers in client.get("/api/state")["samples"].items():
        for performer in performers:
            status, _, content = client.answer("GET", f"/api/samples/{action}/{performer}")
            assert status == 200
            assert content == (EXAMPLES / action / f"{performer}.npz").read_bytes()
    for path in ("squat/nobody", "none/ada", "..%2Fsquat/ada", "squat/..%2F..%2Fsecret"):
        status, _ = client.ask("GET", f"/api/samples/{path}")
        assert status == 404


def test_options_of_reading_are_those_of_the_commands(client: Client, tmp_path: Path) -> None:
    sent = client.send(SQUAT, unit="m")
    assert sent["state"] == "ready"
    assert not any("unit" in note for note in sent["notes"])
    status, answer = client.upload(SQUAT, fps="fast")
    assert (status, answer["error"]["message"]) == (400, "fps must be a number, not 'fast'.")
    refused = client.send(SQUAT, start=1)
    assert refused["message"] == "ada.npz: --start means nothing for a file of joints."


def test_a_file_of_the_wrong_kind_is_refused_and_named(
    client: Client, studio: Studio, tmp_path: Path
) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("no clip")
    status, answer = client.upload(notes)
    assert status == 422
    assert answer["error"]["message"].startswith("notes.txt: .txt is neither a video (.3gp")
    assert client.upload(tmp_path / "notes.txt", name="wave")[0] == 422
    for name, content in (("film.mp4", b"no film"), ("clip.npz", b"no clip"), ("empty.webm", b"")):
        file = tmp_path / name
        file.write_bytes(content)
        failed = client.send(file)
        assert failed["state"] == "failed"
        assert failed["message"].startswith(f"{name}: ")
        assert str(studio.upload_folder.folder) not in failed["message"]
    nothing_left(studio)


def test_what_is_too_large_is_refused_before_it_is_read(client: Client, studio: Studio) -> None:
    with client.begin_upload(f"Content-Length: {5 * 10**9}") as raw:
        response = http.client.HTTPResponse(raw)
        response.begin()
        assert response.status == 413
        assert b"larger than 500 MB" in response.read()
        assert response.getheader("Connection") == "close"
    assert LARGEST_UPLOAD == studio.limit == client.get("/api/state")["limit"]
    assert not left_behind(studio)


def test_what_does_not_announce_its_size_is_cut_off(
    client: Client, studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studio, "limit", 300_000)
    sent = 0
    with client.begin_upload("Transfer-Encoding: chunked") as raw:
        try:
            for _ in range(1000):
                raw.sendall(b"10000\r\n" + bytes(0x10000) + b"\r\n")
                sent += 0x10000
                time.sleep(0.001)
        except OSError:
            pass
    assert 300_000 < sent < 60_000_000
    nothing_left(studio)


def test_a_tab_that_is_closed_while_it_sends_leaves_nothing(client: Client, studio: Studio) -> None:
    with client.begin_upload("Content-Length: 1000000") as raw:
        raw.sendall(bytes(200_000))
        until(lambda: left_behind(studio))
        (file,) = left_behind(studio)
        assert file.stat().st_mode & 0o777 == 0o600
        assert studio.upload_folder.folder.stat().st_mode & 0o777 == 0o700
    nothing_left(studio)


def test_what_is_not_understood_is_told(client: Client) -> None:
    for method, path, body, status in (
        ("PUT", "/api/tau", b"no json", 400),
        ("PUT", "/api/tau", b"[1]", 400),
        ("DELETE", "/api/actions", b"{}", 400),
        ("POST", "/api/clips/none/enroll", b'{"label": "wave"}', 404),
        ("GET", "/api/clips/none", None, 404),
        ("GET", "/api/none", None, 404),
        ("POST", "/api/state", b"{}", 405),
    ):
        got, headers, content = client.answer(method, path, body)
        assert got == status, path
        assert b'"message":' in content
        assert "json" in headers["Content-Type"]
    sent = client.send(SQUAT)
    for label in ("", "a\nb", "x" * 101, 7, None):
        path = f"/api/clips/{sent['id']}/enroll"
        assert client.ask("POST", path, {"label": label})[0] == 400


def test_a_label_may_be_anything_printable(client: Client, tmp_path: Path) -> None:
    strange = "</script> & 'wäve' \u4e2d"
    client.enroll(SQUAT, strange)
    file = tmp_path / "</title>.npz".replace("/", "\u2215")
    file.write_bytes(SQUAT.read_bytes())
    assert client.send(file)["decision"]["nearest"] == strange
    assert client.ask("DELETE", "/api/actions", {"label": strange})[0] == 200


def test_many_at_once(client: Client, studio: Studio) -> None:
    files = sorted(EXAMPLES.glob("*/*.npz"))[:8]
    threads = [
        threading.Thread(target=client.enroll, args=(file, file.parent.name)) for file in files
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(studio.actions.store.examples()) == len(files)
    nothing_left(studio)


def test_a_bug_is_told_to_the_page(
    client: Client, studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr(type(studio.actions), "version", property(broken))
    status, answer = client.ask("GET", "/api/state")
    assert status == 500
    assert "ZeroDivisionError: by zero (this is a bug" in answer["error"]["message"]


def test_a_full_disk_is_told(
    client: Client, studio: Studio, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(studio.upload_folder, "file", full)
    status, answer = client.upload(SQUAT)
    assert (status, answer["error"]["message"]) == (
        400,
        "The upload cannot be kept: No space left on device.",
    )


def test_a_damaged_store_is_told(client: Client, studio: Studio) -> None:
    store = studio.actions.store
    client.enroll(SQUAT, "squat")
    kept = store.path.read_bytes()
    try:
        store.path.write_bytes(b"no database" * 1000)
        for path in ("/api/state", "/api/measurement", "/api/export"):
            status, answer = client.ask("GET", path)
            assert (status, answer["error"]["type"]) == (503, "StoreError")
    finally:
        store.path.write_bytes(kept)

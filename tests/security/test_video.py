"""Hostile videos: they open nothing but themselves, and take little memory."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from actioncli import ClipError
from actioncli.pose.frames import VideoFile
from actioncli.pose.read import ReadOptions
from actioncli.pose.video import read_poses
from tests.pose.videos import Quiet, web_server

from .limits import run_limited


@dataclass
class Listener:
    """Where a web server is, and what it is asked for."""

    address: str
    asked: list[str]


@pytest.fixture
def listener() -> Iterator[Listener]:
    asked: list[str] = []

    class Server(Quiet):
        def answer(self) -> None:
            asked.append(self.path)
            self.send_error(404)

    with web_server(Server) as address:
        yield Listener(urlsplit(address).netloc, asked)


def playlists(address: str) -> dict[str, str]:
    hls = f"#EXTM3U\n#EXT-X-TARGETDURATION:9\n#EXTINF:9,\nhttp://{address}/a.ts\n#EXT-X-ENDLIST\n"
    return {
        "hls.m3u8": hls,
        "hls.mp4": hls,
        "concat.avi": f"ffconcat version 1.0\nfile http://{address}/a.ts\n",
        "rtp.sdp": "v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\n"
        "m=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
        "dash.mpd": '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static" '
        'mediaPresentationDuration="PT9S"><Period><AdaptationSet mimeType="video/mp4">'
        f'<Representation id="1" bandwidth="9"><BaseURL>http://{address}/a.mp4</BaseURL>'
        '<SegmentBase indexRange="0-99"/></Representation></AdaptationSet></Period></MPD>',
    }


def test_a_playlist_in_a_video_opens_no_connection(tmp_path: Path, listener: Listener) -> None:
    for name, content in playlists(listener.address).items():
        file = tmp_path / name
        file.write_text(content)
        with pytest.raises(ClipError, match="not a video"):
            read_poses(file, ReadOptions(cache=False))
    assert listener.asked == []


@pytest.mark.parametrize("scheme", ["http:", "async:http:", "cache:http:", "tcp:", "concat:"])
def test_a_name_like_an_address_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listener: Listener, scheme: str
) -> None:
    """A folder `http:` comes out of any archive."""
    monkeypatch.chdir(tmp_path)
    file = Path(scheme) / listener.address / "a.mp4"
    file.parent.mkdir(parents=True)
    file.write_bytes(b"no video")
    with pytest.raises(ClipError, match="not a video"):
        VideoFile(file)
    assert listener.asked == []


FRAMES = """
import sys
from pathlib import Path
from actioncli.errors import ClipError
from actioncli.pose.frames import VideoFile

here = Path(sys.argv[1])
for side in (9000, 30000, 65535):
    size = side.to_bytes(2, "little") * 2
    # A picture of one colour: header, palette, one block of codes.
    header = b"GIF89a" + size + b"\\x80\\0\\0" + bytes(6) + b"\\x21\\xf9\\x04\\0\\x0a\\0\\0\\0"
    image = b"\\x2c\\0\\0\\0\\0" + size + b"\\0\\x02\\x02\\x44\\x01\\0;"
    file = here / f"{side}.gif"
    file.write_bytes(header + image)
    try:
        for _ in VideoFile(file).frames():
            print(side, "read")
    except ClipError as error:
        print(side, "refused")
"""


def test_frames_of_gigabytes_are_refused(tmp_path: Path) -> None:
    found = run_limited(FRAMES, tmp_path)
    assert "9000 refused" in found
    # Of the largest, FFmpeg itself decodes nothing.
    assert not any(line.endswith("read") for line in found)


def test_a_pipe_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mp4")
    with pytest.raises(ClipError, match="not a regular file"):
        VideoFile(tmp_path / "a.mp4")

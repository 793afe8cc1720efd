"""The live server, by a client that speaks Foxglove's protocol and shares no code with it."""

from __future__ import annotations

import base64
import builtins
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim, trace_of
from foxglove_client import PAUSE, PLAY, TIME, client
from mcap.reader import make_reader
from mcap_files import message_type
from recorded_runs import write_run

from cosim.core import InputError
from cosim.trace.live import Player

S = 10**9


def recorded(path: Path) -> list[tuple[str, int, bytes]]:
    """Messages by the official reader, in order of log time."""
    with path.open("rb") as stream:
        return [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages()
        ]


def test_every_channel_is_advertised_with_its_schema() -> None:
    """Also those without a message, before anything is sent; times of the whole trace."""
    path = trace_of("auv-direct")
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    with Player(path, port=0) as player, client(player.url) as seen:
        assert set(seen.before) <= {TIME}
        assert {"time", "playbackControl"} <= set(seen.info["capabilities"])
        assert seen.info["dataStartTime"] == {"sec": 0, "nsec": 0}
        assert seen.info["dataEndTime"] == {"sec": 180, "nsec": 0}
        assert set(seen.channels) == {c.topic for c in summary.channels.values()}
        for channel in summary.channels.values():
            schema, received = summary.schemas[channel.schema_id], seen.channels[channel.topic]
            assert received["encoding"] == channel.message_encoding
            assert (received["schemaName"], received["schemaEncoding"]) == (
                schema.name,
                schema.encoding,
            )
            assert base64.b64decode(received["schema"]) == schema.data


def test_client_receives_every_message_unchanged() -> None:
    """Every message of every topic, byte for byte, in order; at the end it says so."""
    path = trace_of("paper-example")
    wanted = recorded(path)
    with Player(path, port=0, rate=20) as player, client(player.url) as seen:
        seen.subscribe(*seen.channels)
        messages, state = seen.until("state", lambda s: s["status"] == 3)
        while len(messages) < len(wanted):  # the end may overtake what is on its way
            messages.append(seen.until("message")[1])
    times = [at for _, at, _ in messages]
    assert times == sorted(times)
    for topic in seen.channels:
        mine = [(at, data) for t, at, data in messages if t == topic]
        assert mine == [(at, data) for t, at, data in wanted if t == topic]
    assert state["at"] == times[-1]
    schema = base64.b64decode(seen.channels["/plant/output"]["schema"])
    row = message_type(schema, "cosim.plant.Output")
    last = row.FromString([data for t, _, data in messages if t == "/plant/output"][-1])
    assert last.x_1 == pytest.approx(-0.2848937800327617)


def test_client_controls_pause_seek_and_rate() -> None:
    """No newer message after a pause; after a seek the last messages there, then later ones."""
    path = trace_of("auv-acoustic")
    with Player(path, port=0, rate=8) as player, client(player.url) as seen:
        seen.subscribe("/plant/output", "/auv/pose", "/link/uplink")
        seen.until("message", lambda m: m[1] > 1 * S)
        seen.control(PAUSE, 8, name="stop")
        _, state = seen.until("state", lambda s: s["name"] == "stop")
        assert (state["status"], state["rate"], state["jumped"]) == (1, 8.0, False)
        for _ in range(20):  # of these there are fifty per second
            late, at = seen.until("time")
            assert at == state["at"]
            assert all(m[1] <= state["at"] for m in late)
        # there is nothing left on the way any more
        late, _ = seen.until("time")
        assert late == []
        seen.control(PAUSE, 8, seek_ns=90 * S + 1, name="there")
        _, state = seen.until("state", lambda s: s["name"] == "there")
        assert (state["status"], state["at"], state["jumped"]) == (1, 90 * S + 1, True)
        displayed: list[Any] = []
        while len(displayed) < 3:
            displayed += seen.until("message")[0]
        rows = recorded(path)
        for topic in ("/plant/output", "/auv/pose", "/link/uplink"):
            latest = [(at, data) for t, at, data in rows if t == topic and at <= 90 * S + 1][-1]
            assert [(at, data) for t, at, data in displayed if t == topic] == [latest]
        seen.control(PLAY, 4, name="on")
        _, state = seen.until("state", lambda s: s["name"] == "on")
        assert (state["status"], state["rate"]) == (0, 4.0)
        played, _ = seen.until("message", lambda m: m[1] > 92 * S)
        times = [at for t, at, _ in played if t == "/plant/output"]
        wanted = [at for t, at, _ in rows if t == "/plant/output" and at > 90 * S + 1]
        assert times == wanted[: len(times)]
        assert len(times) > 30
        assert player.playback.rate == 4.0


def test_playback_continues_when_one_client_leaves() -> None:
    """The other client receives every message."""
    with Player(trace_of("auv-acoustic"), port=0, rate=4) as player, client(player.url) as stays:
        with client(player.url) as leaves:
            leaves.subscribe("/plant/output")
            leaves.until("message", lambda m: m[1] > S)
        stays.subscribe("/plant/output")
        messages, _ = stays.until("message", lambda m: m[1] > 3 * S)
        assert messages


def test_a_loop_starts_again_at_its_start_time() -> None:
    """--start and --loop: the state there, the end, and the state there again."""
    path = trace_of("paper-example")
    with (
        Player(path, port=0, rate=20, start_s=8.0, loop=True) as player,
        client(player.url) as seen,
    ):
        seen.subscribe("/plant/output")
        first, _ = seen.until("message", lambda m: m[1] == 10 * S)
        assert [at for _, at, _ in first] == [round((8 + k / 100) * S) for k in range(201)]
        before, state = seen.until("state", lambda s: s["jumped"])  # may be told after the first
        assert 8 * S <= state["at"] < 10 * S
        again, _ = seen.until("message", lambda m: m[1] == 9 * S)
        times = [at for _, at, _ in (*before, *again)]
        assert times == [round((8 + k / 100) * S) for k in range(101)]


def test_play_runs_until_a_signal_ends_it(tmp_path: Path) -> None:
    """It prints one JSON object and serves; Ctrl-C ends it with exit code 0 and no more output."""
    path = trace_of("paper-example")
    command = [sys.executable, "-m", "cosim", "trace", "play", str(path), "--port", "0", "--json"]
    for number in (signal.SIGINT, signal.SIGTERM):
        with subprocess.Popen(  # noqa: S603 - ourselves
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
        ) as process:
            assert process.stdout is not None
            received = json.loads(process.stdout.readline())
            assert received["url"].startswith(f"ws://127.0.0.1:{received['port']}/?token=")
            assert received["not_sent"] == ["publish time", "sequence number"]
            try:
                with client(received["url"]) as seen:
                    assert set(received["topics"]) == set(seen.channels)
                    seen.subscribe("/plant/output")
                    seen.until("message")
                    process.send_signal(number)
                    out, err = process.communicate()
            finally:
                process.kill()
        assert (process.returncode, out, err) == (0, "", "")


def test_play_refuses_invalid_input(tmp_path: Path) -> None:
    """Bad numbers, no trace, a port in use: exit code 2 and a message."""
    path = trace_of("paper-example")
    with Player(path, port=0) as player:
        taken = ("--port", str(player.port))
        for arguments in (
            (path, *taken),
            (path, "--rate", "0"),
            (path, "--rate", "nan"),
            (path, "--rate", "1e9"),
            (path, "--port", "70000"),
            (path, "--start", "-1"),
            (path, "--start", "inf"),
            ("none.mcap",),
        ):
            refused = cosim("trace", "play", *arguments, "--json", cwd=tmp_path)
            assert refused.code == 2, arguments
            assert refused.error["got"] or "there is no such file" in refused.error["what"]


def test_without_websockets_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The message says what to install."""
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("websockets"):
            raise ImportError("No module named 'websockets'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"auv-cosim\[foxglove\]"):
        Player(trace_of("paper-example"), port=0)


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        ({}, False),
        ({"origin": "https://app.foxglove.dev"}, False),
        ({"origin": "http://localhost:8080"}, False),
        ({"host": "localhost"}, False),
        ({"token": ""}, True),
        ({"token": "?token="}, True),
        ({"token": "?token=wrong"}, True),
        ({"token": "?token=é"}, True),
        ({"origin": "https://evil.example"}, True),
        ({"origin": "null"}, True),
        ({"origin": "http://localhost:8081"}, True),
        ({"origin": "https://app.foxglove.dev.evil.example"}, True),
        ({"host": "evil.example"}, True),
        ({"host": "127.0.0.1.evil.example"}, True),
    ],
)
def test_only_who_has_the_token_and_an_allowed_origin_is_served(
    change: dict[str, str], *, refused: bool
) -> None:
    """A web page of any other origin, or of a name that leads to this machine, gets nothing."""
    origins = ["http://localhost:8080/"]
    with Player(trace_of("paper-example"), port=0, origins=origins) as player:
        address, _, token = player.url.partition("?")
        query = change.get("token", f"?{token}")
        lines = [
            f"GET /{query} HTTP/1.1",
            f"Host: {change.get('host', '127.0.0.1')}:{player.port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
            "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Protocol: foxglove.sdk.v1",
        ]
        if "origin" in change:
            lines.append(f"Origin: {change['origin']}")
        with socket.create_connection(("127.0.0.1", player.port), timeout=10) as plain:
            plain.sendall("\r\n".join([*lines, "", ""]).encode())
            answer = plain.recv(4096)
    assert address.startswith("ws://127.0.0.1:")
    # of what is no HTTP, nothing is said
    status = answer.split(b" ")[1] if answer else b""
    assert status in ({b"403", b"400", b""} if refused else {b"101"})
    assert (b"serverInfo" in answer) <= (not refused)


def test_the_token_is_new_each_time_or_as_given() -> None:
    path = trace_of("paper-example")
    tokens = {Player(path, port=0).url for _ in range(3)}
    assert len(tokens) == 3
    given = Player(path, port=0, token="mine-own")  # noqa: S106
    assert given.url.endswith("?token=mine-own")
    for wrong in ("", "short", "with&other=fields", "with a space"):
        with pytest.raises(InputError, match="token"):
            Player(path, port=0, token=wrong)


def test_nonsense_of_a_client_is_answered_and_harmless() -> None:
    """The connection stays, and serves what is asked for next."""
    nonsense: list[str | bytes] = [
        "no JSON",
        "[]",
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',
        b"\x03\x00",
        b"\x09abc",
        b"",
    ]
    with Player(trace_of("paper-example"), port=0, rate=20) as player, client(player.url) as seen:
        for each in nonsense:
            seen._socket.send(each)
        seen.subscribe("/plant/output")
        assert seen.until("message")[1][0] == "/plant/output"


def test_a_damaged_chunk_is_passed_over(tmp_path: Path) -> None:
    """What comes behind it is played; the exit code says that something was not."""
    path = write_run(tmp_path / "a.mcap", 300, chunk_bytes=4000)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    place = summary.chunk_indexes[3].chunk_start_offset
    data = bytearray(path.read_bytes())
    data[place + 200] ^= 1
    path.write_bytes(data)
    with Player(path, port=0, rate=100) as player, client(player.url) as seen:
        seen.subscribe("/plant/output")
        messages, _ = seen.until("message", lambda m: m[1] == 2990 * S // 1000)
        assert 250 < len(messages) < 300
        assert len(player.damage) == 1

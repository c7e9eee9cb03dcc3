"""Who may ask, where the server listens, and what it tells of itself."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import pytest
from pydantic import ValidationError
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from runtime.client import Client
from server.cli import serve_main
from server.settings import Settings


def test_token_is_needed_for_all_that_plans_or_tells(run_server: Callable[..., Any], make_curve: Any) -> None:
    with run_server(token="canary-token") as server:
        for path in ("/plan", "/plans"):
            assert server.post(path, json={}).status_code == 401
        for header in (
            "",
            "Bearer",
            "Bearer canary-toke",
            "Bearer canary-token2",
            "Basic canary-token",
            "Bearer \u00e9",
        ):
            for path in ("/info", "/metrics"):
                answer = server.get(path, headers={"Authorization": header.encode()})
                assert answer.status_code == 401
                assert answer.headers["www-authenticate"] == "Bearer"
        with pytest.raises(InvalidStatus) as caught:
            connect(server.url.replace("http", "ws") + "/stream").__enter__()
        assert caught.value.response.status_code == 401
        for path in ("/", "/health/live", "/health/ready", "/openapi.json"):
            assert server.get(path).status_code == 200
        with Client(server.url, token="canary-token") as client:
            assert len(client.plan(make_curve())) == 300
            client.stream(make_curve()).close()
            assert client.info()["settings"]["token_needed"] is True
            assert client.ready()


def test_info_tells_settings_but_no_secret_and_no_path(run_server: Callable[..., Any]) -> None:
    with run_server(token="canary-token") as server:
        answer = server.get("/info", headers={"Authorization": "Bearer canary-token"})
    assert "canary" not in answer.text
    document = answer.json()
    assert document["settings"]["max_body"] == 1 << 20
    assert "model" not in document["settings"]
    assert document["model"]["name"] == "default"


def test_settings_come_from_variables_and_are_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLIDE_MAX_QUEUE", "7")
    monkeypatch.setenv("SLIDE_TOKEN", "from the environment")
    settings = Settings()
    assert settings.max_queue == 7
    assert "from the environment" not in repr(settings)
    for wrong in ({"max_queue": 0}, {"deadline": 0}, {"port": 70_000}, {"bundle_sha256": "abc"}, {"token": ""}):
        with pytest.raises(ValidationError):
            Settings(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "example.org"])
def test_server_refuses_to_be_reached_from_elsewhere_without_a_token(host: str) -> None:
    with pytest.raises(ValidationError, match="reachable from other machines"):
        Settings(host=host)
    assert Settings(host=host, token="x").host == host  # type: ignore[arg-type]
    assert Settings(host=host, insecure=True).host == host
    for own in ("127.0.0.1", "127.1.2.3", "::1", "localhost"):
        assert Settings(host=own).host == own


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--host", "0.0.0.0"], "host 0.0.0.0 is reachable from other machines: give a token"),
        (["--port", "70000"], "port: Input should be less than or equal to 65535"),
        (["--bundle-sha256", "abc"], "bundle_sha256: String should match pattern"),
    ],
)
def test_slide_serve_says_in_one_line_what_is_wrong(
    arguments: list[str], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["slide-serve", *arguments])
    with pytest.raises(SystemExit) as ended:
        serve_main()
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert said.startswith(f"slide-serve: error: {message}")
    assert said.count("\n") == 1


def test_page_is_kept_by_browsers_while_it_is_the_same_and_answers_are_not(server: Any) -> None:
    for path in ("/", "/info"):
        answer = server.get(path)
        assert answer.status_code == 200
        assert answer.headers["cache-control"] == ("no-cache" if path == "/" else "no-store")
        again = server.get(path, headers={"If-None-Match": answer.headers.get("etag", "*")})
        assert again.status_code == (304 if path == "/" else 200)


def test_page_and_answers_carry_the_headers_that_protect_them(server: Any) -> None:
    for path in ("/", "/health/live", "/nowhere"):
        headers = server.get(path).headers
        assert headers["content-security-policy"].startswith("default-src 'self';")
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
        assert headers["referrer-policy"] == "no-referrer"
        assert "server" not in headers

"""Where the dashboard is served and how it ends, and what is said when it cannot be."""

import asyncio
import json
import shutil
import ssl
import subprocess
import urllib.request

import pytest

from gcs.errors import ServiceError
from gcs.monitor import beside
from gcs.monitor.access import COMMAND_VARIABLE, VIEW_VARIABLE, Token, Tokens
from gcs.monitor.beside import dashboard_beside
from gcs.monitor.web.finding import RunFinder
from gcs.monitor.web.place import Place, listening, place_of, require_certificate
from gcs.monitor.web.server import serve
from tests.gcs.monitor.web.browsing import DASHBOARD, VIEW, Dashboard, started, until_served


@pytest.mark.parametrize(
    ("text", "host", "port", "url"),
    [
        ("127.0.0.1:8080", "127.0.0.1", 8080, "http://127.0.0.1:8080/"),
        ("[::1]:80", "::1", 80, "http://[::1]:80/"),
        ("field-laptop:65535", "field-laptop", 65535, "http://field-laptop:65535/"),
    ],
)
def test_a_place_is_a_host_and_a_port(text, host, port, url):
    place = place_of(text)
    assert (place.host, place.port, place.url) == (host, port, url)


@pytest.mark.parametrize(
    "text", ["", "8080", ":8080", "127.0.0.1", "127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "a:b"]
)
def test_what_is_no_place_is_refused_with_one_that_is(text):
    with pytest.raises(ServiceError, match=r"127\.0\.0\.1:8080"):
        place_of(text)


def test_half_a_certificate_or_one_that_is_none_is_refused(tmp_path):
    file = tmp_path / "certificate.pem"
    with pytest.raises(ServiceError, match="go together"):
        place_of("127.0.0.1:8080", certificate=file)
    file.write_text("no certificate")
    for name in (file, tmp_path / "none"):
        with pytest.raises(ServiceError, match="PEM certificate"):
            require_certificate(Place("127.0.0.1", 8080, name, name))


async def test_a_port_that_is_taken_is_said_with_the_way_out(tmp_path):
    with listening(Place("127.0.0.1", 0)) as taken:
        place = Place("127.0.0.1", taken.getsockname()[1])
        with pytest.raises(ServiceError, match="Take another port"):
            await serve(place, Tokens(), RunFinder(tmp_path))


async def test_it_is_not_served_off_loopback_in_the_open(tmp_path):
    with pytest.raises(ServiceError, match="--insecure"):
        await serve(Place("0.0.0.0", 0), Tokens(view=Token(VIEW)), RunFinder(tmp_path))


def test_beside_a_run_it_is_on_loopback_and_what_is_wrong_is_said_before_the_flight(tmp_path, monkeypatch):
    for variable in (VIEW_VARIABLE, COMMAND_VARIABLE):
        monkeypatch.delenv(variable, raising=False)
    with dashboard_beside(None, tmp_path) as address:
        assert address is None
    with pytest.raises(ServiceError, match="bearing-relay dashboard --listen"), dashboard_beside("0.0.0.0:1", tmp_path):
        pass
    with listening(Place("127.0.0.1", 0)) as taken:
        place = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ServiceError, match="Take another port"), dashboard_beside(place, tmp_path):
            pass
    monkeypatch.setenv(COMMAND_VARIABLE, "short")
    with pytest.raises(ServiceError, match=COMMAND_VARIABLE), dashboard_beside("127.0.0.1:9", tmp_path):
        pass
    monkeypatch.delenv(COMMAND_VARIABLE)
    monkeypatch.setattr(beside, "find_spec", lambda _: None)
    with pytest.raises(ServiceError, match="pip install"), dashboard_beside("127.0.0.1:9", tmp_path):
        pass


PARENT = "import os, subprocess, sys; subprocess.run([sys.executable, *sys.argv[1:], str(os.getpid())])"


def answer(url, context=None):
    with urllib.request.urlopen(url, timeout=5.0, context=context) as reply:
        return reply.read(), reply.headers


@pytest.mark.slow
async def test_it_ends_when_told_to_and_with_its_parent(tmp_path):
    site = Dashboard(tmp_path, tokens={})
    async with site.open() as process:
        body, _ = await asyncio.to_thread(answer, site.url + "about")
        assert json.loads(body)["role"] == "VIEW"
        process.terminate()
        assert await asyncio.wait_for(process.wait(), 5.0) == 0
    place = ("--listen", f"127.0.0.1:{site.port}", "--runs-dir", str(tmp_path), "--parent-pid")
    async with started("-c", PARENT, *DASHBOARD, *place) as process:
        await until_served(site.port)
        process.kill()
    await until_served(site.port, served=False)


@pytest.mark.slow
async def test_beside_a_run_it_is_served_as_long_as_the_block_lasts(tmp_path):
    site = Dashboard(tmp_path)
    with dashboard_beside(f"127.0.0.1:{site.port}", tmp_path / "runs") as address:
        assert address == site.url
        await until_served(site.port)
        body, _ = await asyncio.to_thread(answer, site.url + "about")
        assert "no run in" in json.loads(body)["problem"]
    await until_served(site.port, served=False)


@pytest.mark.slow
async def test_over_tls_the_cookie_is_for_tls_only(tmp_path):
    if (openssl := shutil.which("openssl")) is None:
        pytest.skip("needs openssl")
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    made = ["req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "1"]
    subject = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    command = [openssl, *made, *subject, "-keyout", key, "-out", certificate]
    await asyncio.to_thread(subprocess.run, command, check=True, capture_output=True)
    site = Dashboard(tmp_path, options=("--certificate", str(certificate), "--key", str(key)))
    context = ssl.create_default_context(cafile=certificate)
    async with site.open():
        url = site.url.replace("http:", "https:")
        form = urllib.request.Request(url + "login", f"token={VIEW}".encode(), {"origin": url.rstrip("/")})
        opener = urllib.request.build_opener(Staying, urllib.request.HTTPSHandler(context=context))
        reply = await asyncio.to_thread(opener.open, form)
        cookie = reply.headers["set-cookie"]
        reply.close()
    assert cookie.startswith("__Host-")
    assert "; Secure" in cookie


class Staying(urllib.request.HTTPRedirectHandler):
    """Shows the redirect itself."""

    def http_error_303(self, request, reply, *_):
        return reply

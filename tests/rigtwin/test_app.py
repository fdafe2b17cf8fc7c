"""``rigtwin app``: a campaign goes in, its diagnosis comes out; nobody else gets in, and nothing is left behind."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rigtwin.app import uploads
from rigtwin.app.uploads import unpack
from rigtwin.app.worker import run as run_worker
from rigtwin.errors import UserError
from tests.rigtwin.conftest import run

pytest.importorskip("dash", reason="needs the extra app")

STAND_IN = (sys.executable, "-m", "tests.rigtwin.stand_in_diagnosis")
CHROMIUM = shutil.which("chromium")
TOML = 'title = "{title}"\nrig = "nit-rourkela"\n'


RUN = '[[run]]\nfile = "no.csv"\nsupport = "rigid"\nexcitation_node = 2\nforce_amplitude_N = 1.0\n'


def campaign_files(title: str) -> list[tuple[str, bytes]]:
    return [("campaign.toml", TOML.format(title=title).encode()), ("run01.csv", b"frequency_Hz,node2_re,node2_im\n")]


def zipped(*files: tuple[str, bytes], **attributes: int) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files:
            entry = zipfile.ZipInfo(name)
            entry.compress_type = zipfile.ZIP_DEFLATED
            for key, value in attributes.items():
                setattr(entry, key, value)
            archive.writestr(entry, content)
    return buffer.getvalue()


def waits_for(what: Callable[[], Any], seconds: float = 20.0) -> Any:
    """What a function returns as soon as that is true."""
    end = time.monotonic() + seconds
    while not (value := what()):
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.05)
    return value


def is_running(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


# -- what is sent ------------------------------------------------------------------------------------------


def test_a_folder_as_an_archive_and_its_files_alone_are_the_same_campaign(tmp_path):
    files = campaign_files("a")
    inside = [(f"measured\\{name}", content) for name, content in files]  # as a program for Windows packs them
    notes = [("measured/photo.jpg", b"no data"), ("__MACOSX/measured/._campaign.toml", b"\0")]
    (tmp_path / "1").mkdir()
    (tmp_path / "2").mkdir()
    from_archive = unpack([("measured.zip", zipped(*inside, *notes))], tmp_path / "1")
    from_files = unpack(files, tmp_path / "2")
    assert from_archive == tmp_path / "1" / "measured"
    for folder in (from_archive, from_files):
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == dict(files)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("../campaign.toml", "lies outside the archive"),
        ("a/../../campaign.toml", "lies outside the archive"),
        ("/tmp/campaign.toml", "lies outside the archive"),
        ("..\\campaign.toml", "lies outside the archive"),
        ("C:\\campaign.toml", "lies outside the archive"),
    ],
)
def test_an_archive_cannot_write_elsewhere(tmp_path, name, words):
    inside = tmp_path / "inside"
    inside.mkdir()
    with pytest.raises(UserError, match=words):
        unpack([("a.zip", zipped((name, b"")))], inside)
    assert list(tmp_path.rglob("*")) == [inside]


def test_a_link_in_an_archive_is_refused(tmp_path):
    with pytest.raises(UserError, match="is a link"):
        unpack([("a.zip", zipped(("campaign.toml", b"/etc/passwd"), external_attr=0o120777 << 16))], tmp_path)


def test_a_file_that_grows_too_large_is_stopped_whatever_its_archive_says(tmp_path, monkeypatch):
    monkeypatch.setattr(uploads, "MOST_UNPACKED", 1_000_000)
    bomb = zipped(("campaign.toml", b" " * 5_000_000))
    assert len(bomb) < 10_000
    with pytest.raises(UserError, match="when they are unpacked"):
        unpack([("a.zip", bomb)], tmp_path)
    assert (tmp_path / "campaign.toml").stat().st_size <= 1_000_000


def test_too_many_files_and_too_large_ones_are_refused(tmp_path, monkeypatch):
    with pytest.raises(UserError, match="more than 1000 files"):
        unpack([("a.zip", zipped(*((f"{n}.csv", b"") for n in range(1001))))], tmp_path)
    monkeypatch.setattr(uploads, "MOST_SENT", 10)
    with pytest.raises(UserError, match="larger than 0 MB together"):
        unpack(campaign_files("a"), tmp_path)


def damaged(compression: int) -> bytes:
    """An archive whose file cannot be unpacked."""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", compression) as archive:
        archive.writestr("campaign.toml", b"title = 'a'\n" * 1000)
    content = bytearray(made.getvalue())
    start = 30 + len("campaign.toml")
    content[start + 8 : start + 40] = b"\xff" * 32
    return bytes(content)


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        ([("run.csv", b"")], "there is no campaign.toml among the files"),
        ([("a.zip", b"PK no archive")], "not an archive that can be read"),
        ([("a.zip", zipped(("a/campaign.toml", b""), ("b/campaign.toml", b"")))], "there are 2 campaigns"),
        ([("a.zip", zipped(("campaign.toml", b""), ("campaign.toml/x.csv", b"")))], "cannot be stored"),
        ([("a" * 300 + ".csv", b"")], "cannot be stored"),
        ([("a.zip", damaged(zipfile.ZIP_LZMA))], "not an archive that can be read"),
        ([("a.zip", damaged(zipfile.ZIP_BZIP2))], "not an archive that can be read"),
    ],
)
def test_what_is_no_campaign_is_refused_in_a_sentence(tmp_path, sent, words):
    with pytest.raises(UserError, match=words):
        unpack(sent, tmp_path)


def test_a_damaged_archive_is_refused(tmp_path):
    whole = bytearray(zipped(("campaign.toml", os.urandom(2000))))
    whole[200] ^= 0xFF
    with pytest.raises(UserError, match="not an archive that can be read"):
        unpack([("a.zip", bytes(whole))], tmp_path)


def test_the_process_tells_what_is_wrong_with_a_campaign_without_its_folder(tmp_path):
    (tmp_path / "campaign.toml").write_text(TOML.format(title="a") + RUN, encoding="utf-8")
    told = io.StringIO()
    assert run_worker(tmp_path, tmp_path / "out", told) == 2
    error = json.loads(told.getvalue())["error"]
    assert "no.csv" in error
    assert str(tmp_path) not in error


# -- the server --------------------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path, monkeypatch) -> Iterator[Any]:
    """The app with a stand-in for the diagnosis, in a thread."""
    from rigtwin.app.server import AppServer

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    started = AppServer(0, STAND_IN)
    thread = threading.Thread(target=started.serve)
    thread.start()
    yield started
    started.stop()
    thread.join(20)
    assert not thread.is_alive()
    assert list(tmp_path.glob("rigtwin_app_*")) == []


def answer(address: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=20) as response:
            return response.status
    except urllib.error.HTTPError as error:
        return error.code


def test_pages_of_others_get_no_answer(server):
    assert answer(server.address) == 200
    assert answer(server.address, Host="evil.example") == 403
    assert answer(server.address, Host=f"evil.example:{server.port}") == 403
    assert answer(server.address, Origin="http://evil.example") == 403
    assert answer(server.address, Origin="null") == 403
    assert answer(server.address, Origin=server.address) == 200


def test_it_listens_on_this_machine_alone(server):
    listening = {
        line.split()[1]
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
        if line.split()[3] == "0A" and line.split()[1].endswith(f":{server.port:04X}")
    }
    assert listening == {f"0100007F:{server.port:04X}"}


def test_there_is_no_result_before_there_is_one_and_no_other_file(server):
    for name in ("report.html", "diagnosis.json", "campaign.toml"):
        assert answer(f"{server.address}/result/{name}") == 404
    for name in ("app/view.py", "pages/templates/style.css"):
        assert answer(f"{server.address}/assets/{name}") == 404


def test_a_port_in_use_is_refused_in_a_sentence(refused, server):
    assert "cannot be used (Address already in use); give another one with --port" in refused(
        "app", "--port", server.port, "--no-browser"
    )


def test_without_dash_a_sentence_says_how_to_get_it(refused, monkeypatch):
    monkeypatch.setattr("rigtwin.commands.app.find_spec", lambda _: None)
    assert "pip install 'rigtwin[app]'" in refused("app")
    assert run("app").exit_code == 2


# -- in a browser ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if not CHROMIUM:
        pytest.skip("needs chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


def is_foreign(url: str, server: Any) -> bool:
    return not url.startswith((server.address, "data:"))


@pytest.fixture
def tab(browser, server) -> Iterator[Any]:
    """The app's page; in the end it has complained of nothing and asked nobody else."""
    page = browser.new_page(viewport={"width": 900, "height": 700})
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda asked: complaints.append(asked.url) if is_foreign(asked.url, server) else None)
    page.goto(server.address)
    page.wait_for_selector("#choose")
    yield page
    page.close()
    assert complaints == []


def send(tab: Any, *files: tuple[str, bytes]) -> None:
    sent = [{"name": name, "mimeType": "application/octet-stream", "buffer": content} for name, content in files]
    tab.set_input_files("input[type=file]", sent)


def test_a_campaign_is_diagnosed_its_stages_are_seen_and_its_result_is_read_and_downloaded(tab):
    inside = [(f"lab/{name}", content) for name, content in campaign_files("the lab")]
    send(tab, ("lab.zip", zipped(*inside)))
    tab.wait_for_selector("#sentence")
    assert "causes the gap of the lab" in tab.inner_text("#sentence")
    tab.click("summary")
    assert "candidate 2, 2 of 3" in tab.inner_text("#progress")
    assert tab.frame_locator("iframe").locator("h1").inner_text() == "the lab"
    with tab.expect_download() as download:
        tab.click("text=Download diagnosis.json")
    assert json.loads(Path(download.value.path()).read_text(encoding="utf-8")) == {"title": "the lab"}
    assert tab.is_disabled("#cancel")


def test_a_diagnosis_is_cancelled_and_another_one_follows(tab, server):
    send(tab, *campaign_files("slow"))
    tab.wait_for_selector("text=candidate 0, 0 of 3")
    first = server.worker_pid
    tab.click("#cancel")
    tab.wait_for_selector("text=Cancelled.")
    assert not is_running(first)
    send(tab, *campaign_files("the next"))
    tab.wait_for_selector("#sentence")
    assert "the next" in tab.inner_text("#sentence")


def test_what_goes_wrong_is_said(tab):
    send(tab, ("run01.csv", b""))
    tab.wait_for_selector("[role=alert]")
    assert "there is no campaign.toml" in tab.inner_text("[role=alert]")
    send(tab, *campaign_files("broken"))
    tab.wait_for_selector("text=it fell down the stairs")
    assert "ended without a result (exit code 1)" in tab.inner_text("[role=alert]")


def test_the_page_is_reached_by_the_keyboard_and_dark_where_the_system_is(tab):
    tab.emulate_media(color_scheme="dark")
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 24, 29)"
    seen = []
    for _ in range(3):
        tab.keyboard.press("Tab")
        seen.append(tab.evaluate("document.activeElement.id"))
    assert "choose" in seen
    tab.set_viewport_size({"width": 400, "height": 700})
    assert tab.evaluate("document.documentElement.scrollWidth") <= 400


# -- how it ends -------------------------------------------------------------------------------------------


def test_a_killed_app_leaves_no_process_and_the_next_command_removes_its_folder(tmp_path):
    script = (
        "import sys; from rigtwin.app.server import AppServer\n"
        f"server = AppServer(0, {STAND_IN!r})\n"
        f"server._bench.start({campaign_files('slow')!r})\n"
        "print(server.worker_pid, flush=True)\n"
        "server.serve()\n"
    )
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    app = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, env=environment)
    assert app.stdout
    worker = int(app.stdout.readline())
    assert is_running(worker)
    app.send_signal(signal.SIGKILL)
    app.wait()
    app.stdout.close()
    waits_for(lambda: not is_running(worker))
    assert list(tmp_path.glob("rigtwin_app_*"))
    command = [sys.executable, "-m", "rigtwin", "effects", "rub"]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    assert list(tmp_path.glob("rigtwin_*")) == []


def test_the_process_that_diagnoses_ends_when_the_app_has_ended(tmp_path):
    """Its stdin is then closed; the diagnosis of this campaign would take longer than this test waits."""
    campaign = Path(__file__).resolve().parents[2] / "benchmarks" / "stored_campaigns" / "ross_pedestals" / "measured"
    command = [sys.executable, "-m", "rigtwin.app.worker", str(campaign), str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL) as worker:
        assert worker.stdin
        worker.stdin.close()
        try:
            assert worker.wait(timeout=8) == 1
        finally:
            worker.kill()
    assert list(tmp_path.iterdir()) == []


def test_the_command_says_where_it_is_and_ends_at_an_interrupt(tmp_path):
    command = [sys.executable, "-m", "rigtwin", "app", "--port", "0", "--no-browser"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    app = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    assert app.stdout
    address = app.stdout.readline().split()[3].rstrip(",")
    assert answer(address) == 200
    app.send_signal(signal.SIGINT)
    _, said = app.communicate(timeout=20)
    assert (app.returncode, said.splitlines()) == (130, ["rigtwin: interrupted"])
    assert list(tmp_path.glob("rigtwin_*")) == []

#!/usr/bin/env python3
"""The view of a live drive in a headless Chromium, its metrics, and the report, against what others received.

view_test.py PROGRAMS RULES [--screenshots FOLDER]     exit status: 77 = skipped
"""

import argparse
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from chromium import Page, find_chromium  # noqa: E402

failures = []


def check(good, text):
    print(("ok    " if good else "FAILED") + " " + text, flush=True)
    if not good:
        failures.append(text)


def get(url, headers=None, timeout=10):
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers or {}), timeout=timeout) as answer:
        return answer.status, answer.read().decode("utf-8", "replace")


class Drive:
    """A simulated drive that niliod replays at the pace of the sensor, and a view of it."""

    def __init__(self, programs, folder):
        self.programs, self.folder = programs, folder
        self.domain = 100 + os.getpid() % 100
        self.children = []

    def start(self, name, *arguments, log):
        out = open(os.path.join(self.folder, log), "w")
        child = subprocess.Popen([os.path.join(self.programs, name), *arguments], stdout=out, stderr=subprocess.STDOUT)
        self.children.append(child)
        return child

    def niliod(self, output):
        return self.start("niliod", "--replay", f"{self.folder}/drive", "--speed", "real", "--output", f"{self.folder}/{output}",
                          "--set", f"publisher.domain={self.domain}", "--set", 'publisher.interfaces=["127.0.0.1"]', log=f"{output}.log")

    def view(self, *arguments):
        child = self.start("nilio", "view", "--no-browser", "--port", "0", *arguments, log="view.log")
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline:
            text = open(f"{self.folder}/view.log").read()
            if "http://" in text:
                return child, "http://" + text.split("http://")[1].split()[0]
            time.sleep(0.05)
        raise RuntimeError("nilio view does not start: " + text)

    def stop(self):
        for child in self.children:
            if child.poll() is None:
                child.kill()
            child.wait()


def check_requests(url):
    for path, expected in [("/", 200), ("/metrics", 200), ("/nothing", 404), ("/../etc/passwd", 404), ("/%2e%2e/etc/passwd", 404)]:
        try:
            status = get(url + path)[0]
        except urllib.error.HTTPError as error:
            status = error.code
        check(status == expected, f"GET {path}: {status}")
    try:
        get(url + "/", {"Host": "elsewhere.example"})
        check(False, "another Host is refused")
    except urllib.error.HTTPError as error:
        check(error.code == 403, f"another Host: {error.code}")
    host, port = url[7:].split(":")
    slow = []
    for _ in range(400):
        try:
            connection = socket.create_connection((host, int(port)), timeout=1)
            connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-")
            slow.append(connection)
        except OSError:
            break
    begin = time.monotonic()
    status = get(url + "/metrics")[0]
    took = time.monotonic() - begin
    check(status == 200 and took < 3, f"an honest client beside {len(slow)} unfinished requests: {status} after {took:.2f} s")
    for connection in slow:
        connection.close()
    for garbage in (b"\0" * 200, b"BLAH / HTTP/1.1\r\n\r\n", b"GET " + b"A" * 20000, b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 5000, b"\x16\x03\x01\x02\x00\x01"):
        with socket.create_connection((host, int(port)), timeout=5) as connection:
            try:
                connection.sendall(garbage)
                connection.settimeout(1)
                connection.recv(1000)
            except OSError:
                pass
    check(get(url + "/metrics")[0] == 200, "the server answers after damaged requests")


def check_metrics(url, folder, rules):
    text = get(url + "/metrics")[1]
    if not shutil.which("promtool"):
        print("skipped: promtool is not installed (package prometheus)")
        return
    lint = subprocess.run(["promtool", "check", "metrics"], input=text, capture_output=True, text=True)
    check(lint.returncode == 0, f"promtool check metrics: {lint.returncode} {lint.stdout}{lint.stderr}".strip())
    check(get(url + "/metrics", {"Accept": "application/openmetrics-text"})[1].endswith("# EOF\n"), "OpenMetrics ends with # EOF")
    for command in (["check", "rules", "--lint-fatal", "nilio.rules.yml"], ["test", "rules", "nilio.rules.test.yml"]):
        done = subprocess.run(["promtool", *command], cwd=rules, capture_output=True, text=True)
        check(done.returncode == 0, f"promtool {' '.join(command)}: {done.returncode} {done.stderr}".strip())


def check_prometheus(drive, url, rules):
    """A live scrape: every query of the dashboard answers."""
    if not shutil.which("prometheus"):
        print("skipped: prometheus is not installed")
        return
    with open(f"{drive.folder}/prometheus.yml", "w") as file:
        file.write(f"""global: {{scrape_interval: 1s, evaluation_interval: 1s}}
rule_files: [{os.path.abspath(rules)}/nilio.rules.yml]
scrape_configs:
  - {{job_name: nilio, static_configs: [{{targets: ["{url[7:]}"]}}]}}
""")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = open(f"{drive.folder}/prometheus.log", "w")
    child = subprocess.Popen(["prometheus", f"--config.file={drive.folder}/prometheus.yml", f"--storage.tsdb.path={drive.folder}/tsdb",
                              f"--web.listen-address=127.0.0.1:{port}"], stdout=log, stderr=subprocess.STDOUT)
    drive.children.append(child)
    time.sleep(12)
    dashboard = json.load(open(f"{rules}/grafana.json"))
    queries = [target["expr"] for panel in dashboard["panels"] for target in panel["targets"]]
    empty = []
    for query in queries:
        plain = query.replace("$__rate_interval", "10s").replace("$instance", ".*")
        answer = json.loads(get(f"http://127.0.0.1:{port}/api/v1/query?query={urllib.request.quote(plain)}")[1])
        if answer["status"] != "success" or not answer["data"]["result"]:
            empty.append(plain)
    check(not empty, f"queries of the dashboard that answer: {len(queries) - len(empty)} of {len(queries)} {empty}")
    targets = json.loads(get(f"http://127.0.0.1:{port}/api/v1/targets")[1])["data"]["activeTargets"]
    check(targets[0]["health"] == "up", f"Prometheus scrapes the view: {targets[0]['health']} {targets[0]['lastError']}")
    child.terminate()
    child.wait()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs")
    parser.add_argument("rules")
    parser.add_argument("--screenshots")
    options = parser.parse_args()
    if not find_chromium():
        print("skipped: chromium is not installed")
        return 77
    folder = tempfile.mkdtemp(prefix="nilio-view-")
    drive = Drive(options.programs, folder)
    try:
        subprocess.run([f"{options.programs}/nilio", "simulate", f"{folder}/drive", "--sensor", "vlp16", "--realism", "ideal", "--duration", "70"], check=True,
                       capture_output=True)
        view, url = drive.view("--domain", str(drive.domain), "--interface", "127.0.0.1")
        if "left out" in open(f"{folder}/view.log").read() or "no page" in open(f"{folder}/view.log").read():
            print("skipped: this build has no page")
            return 77
        watch = drive.start("nilio", "watch", "--domain", str(drive.domain), "--interface", "127.0.0.1", "--tum", f"{folder}/watch.tum", "--json",
                            f"{folder}/watch.json", log="watch.log")
        niliod = drive.niliod("run")
        with Page() as page:
            page.open(url)
            page.wait("window.nilio && nilio.ready && nilio.state.alive", 30)
            page.wait("nilio.summary && nilio.summary.stages && nilio.state.received > 150", 60)
            check_requests(url)
            check_metrics(url, folder, options.rules)
            page.wait("nilio.stage.drives[0].tiles.size > 0", 20)
            check(page.run("nilio.stage.drives[0].path.count") > 20, "the path is on the page")
            state = json.loads(page.run("JSON.stringify(nilio.state)"))
            stamp = state["pose"]["stamp_ns"]
            check(abs(state["rate_hz"] - 10) < 0.3, f"rate on the page: {state['rate_hz']:.2f} Hz")
            check(state["scan"]["state"] == "tracking" and state["lost"] == 0, f"state {state['scan']['state']}, {state['lost']} lost")
            shown = page.run("document.querySelector('.badge').textContent")
            check("tracking" in shown, f"badge: {shown}")
            check_prometheus(drive, url, options.rules)
            page.run("nilio.stage.setMode('follow')")
            time.sleep(4)
            rate = page.run("nilio.stage.frameRate()")
            cost = page.run("nilio.stage.frames.reduce((sum, frame) => sum + frame[1], 0) / nilio.stage.frames.length")
            # A loaded computer gives a page fewer frames than it could draw.
            check(rate >= 15 or cost < 1000 / 15, f"frames/s while driving, without a graphics processor: {rate:.1f}, {cost:.1f} ms each, "
                  f"{page.run('nilio.stage.drawn')} points")
            heap, nodes = page.heap_bytes()
            print(f"      heap {heap / 1e6:.1f} MB, {nodes} nodes")
            if options.screenshots:
                os.makedirs(options.screenshots, exist_ok=True)
                page.screenshot(f"{options.screenshots}/view-dark.png")
                page.theme(False)
                time.sleep(0.7)
                page.screenshot(f"{options.screenshots}/view-light.png")
                page.resize(390, 844, 2)
                time.sleep(0.7)
                page.screenshot(f"{options.screenshots}/view-narrow.png")
                page.resize(1440, 860)
                page.theme(True)
            niliod.send_signal(signal.SIGKILL)
            niliod.wait()
            page.wait("!nilio.state.alive", 5)
            check(page.run("!document.getElementById('silence').hidden"), "a dead daemon is said on the page")
            niliod = drive.niliod("second")
            deadline = time.monotonic() + 30
            while "nilio-publisher started" not in open(f"{folder}/second.log").read() and time.monotonic() < deadline:
                time.sleep(0.02)
            back = page.wait("nilio.state.alive", 30)
            print(f"      poses again {back:.1f} s after the publisher's start")
            view.send_signal(signal.SIGTERM)
            begin = time.monotonic()
            check(view.wait(5) == 0 and time.monotonic() - begin < 1.5, "SIGTERM ends the view with status 0 within a second")
            page.wait("!nilio.linked", 5)
            view = drive.start("nilio", "view", "--no-browser", "--port", url.rsplit(":", 1)[1], "--domain", str(drive.domain), "--interface",
                               "127.0.0.1", log="view2.log")
            back = page.wait("nilio.linked && nilio.state.alive", 10)
            check(back < 3, f"the page has reconnected to a restarted view after {back:.1f} s")
            check(not page.errors, f"exceptions on the page: {page.errors}")
            niliod.terminate()
            niliod.wait()
        view.send_signal(signal.SIGINT)
        check(view.wait(5) == 130, "Ctrl-C ends the view with status 130")
        watch.send_signal(signal.SIGINT)
        watch.wait(10)
        stamps = {line.split()[0] for line in open(f"{folder}/watch.tum")}
        check(f"{stamp[:-9]}.{stamp[-9:]}" in stamps, f"the subscriber received the pose of the page, {stamp}")
        check_report(options, drive)
    finally:
        drive.stop()
        shutil.rmtree(folder, ignore_errors=True)
    print(f"{len(failures)} failed")
    return 1 if failures else 0


def check_report(options, drive):
    """The report from disk, without network, with the figures of nilio evaluate."""
    folder = drive.folder
    nilio = f"{options.programs}/nilio"
    subprocess.run([f"{options.programs}/niliod", "--replay", f"{folder}/drive", "--output", f"{folder}/whole", "--set",
                    "publisher.enabled=false"], check=True, capture_output=True)
    truth = f"{folder}/drive/truth.tum"
    subprocess.run([nilio, "report", f"{folder}/whole", "--truth", truth, "--html", f"{folder}/report.html"], check=True, capture_output=True)
    size = os.path.getsize(f"{folder}/report.html")
    check(size < 20e6, f"report: {size / 1e6:.1f} MB")
    evaluation = json.loads(subprocess.run([nilio, "evaluate", truth, f"{folder}/whole/trajectory.tum", "--json", "-"], check=True,
                                           capture_output=True, text=True).stdout)
    with Page() as page:
        page.call("Network.enable")
        page.call("Network.emulateNetworkConditions", {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0})
        page.open(f"file://{folder}/report.html")
        took = page.wait("window.nilio && nilio.ready", 30)
        print(f"      report is ready after {took:.2f} s")
        inside = json.loads(page.run("JSON.stringify(nilio.stage.drives[0].run.evaluation)"))
        check(inside == evaluation, "figures of the report equal nilio evaluate --json")
        check(page.run("nilio.stage.drawn") > 10000, f"points drawn: {page.run('nilio.stage.drawn')}")
        text = page.run("document.getElementById('panels').textContent")
        check("latency" not in text.lower().replace("says nothing of latency", ""), "a replay at full speed shows no latency")
        check(not page.errors, f"exceptions on the report: {page.errors}")
        if options.screenshots:
            time.sleep(1)
            page.screenshot(f"{options.screenshots}/report.png")


if __name__ == "__main__":
    sys.exit(main())

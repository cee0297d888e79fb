#!/usr/bin/env python3
"""The view of a live drive in a headless Chromium, its metrics, and the report, against what others received.

view_test.py PROGRAMS RULES [--screenshots FOLDER]     exit status: 77 = skipped
view_test.py PROGRAMS RULES --soak MINUTES             heap of the page and memory of the view beside an HDL-64E
view_test.py PROGRAMS RULES --latency RUNS             latency of niliod alone, with a client, and beside a page that draws
"""

import argparse
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
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

    def simulate(self, *options):
        subprocess.run([f"{self.programs}/nilio", "simulate", f"{self.folder}/drive", *options], check=True, capture_output=True)

    def niliod(self, output, *options):
        return self.start("niliod", *(options or ("--replay", f"{self.folder}/drive", "--speed", "real")), "--output", f"{self.folder}/{output}",
                          "--set", f"publisher.domain={self.domain}", "--set", 'publisher.interfaces=["127.0.0.1"]', log=f"{output}.log")

    def watch(self, name):
        return self.start("nilio", "watch", "--domain", str(self.domain), "--interface", "127.0.0.1", "--tum", f"{self.folder}/{name}.tum", "--json",
                          f"{self.folder}/{name}.json", log=f"{name}.log")

    def live_view(self):
        return self.view("--domain", str(self.domain), "--interface", "127.0.0.1")

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
    # 10,000 clients that never finish their request, 400 at a time.
    for _ in range(10_000):
        connection = socket.create_connection((host, int(port)), timeout=1)
        slow.append(connection)
        try:
            connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-")
        except OSError:
            pass
        if len(slow) > 400:
            slow.pop(0).close()
    begin = time.monotonic()
    status = get(url + "/metrics")[0]
    took = time.monotonic() - begin
    check(status == 200 and took < 3, f"an honest client beside 10,000 unfinished requests: {status} after {took:.2f} s")
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


# The page keeps what it showed for each number of poses.
KEEP_REPORTS = """window.reports = {};
setInterval(() => {
  const s = nilio.summary?.stages?.find((stage) => stage.name === 'received_to_written');
  if (!s) return;
  const figures = document.querySelectorAll('.card')[1].querySelectorAll('.figure');
  reports[s.count] = {stage: s, counts: nilio.summary.counts, published: nilio.summary.published, lost: nilio.state.lost, shown: [...figures].map((f) => f.textContent)};
}, 50)"""


def check_against_subscriber(page, drive):
    # The page is told once a second, so it may skip a report: the next subscriber then ends with another one.
    for attempt in range(6):
        watch = drive.watch("reports")
        time.sleep(3.3)
        watch.send_signal(signal.SIGINT)
        watch.wait(10)
        received = json.load(open(f"{drive.folder}/reports.json"))
        stage = received.get("publisher", {}).get("stages", {}).get("received_to_written", {"count": 0})
        time.sleep(1.2)
        report = page.run(f"reports[{stage['count']}]")
        if report:
            break
    check(bool(report), f"the page has shown a latency report that a subscriber received ({attempt + 1} tried)")
    if not report:
        return
    for key in ("p50_us", "p90_us", "p99_us", "p99_9_us", "max_us"):
        check(report["stage"][key] == stage[key], f"{key}: {report['stage'][key]} on the page, {stage[key]} received")
    for figure, key in zip(report["shown"], ("p50_us", "p99_us", "max_us")):
        value, unit = re.match(r"([\d.]+) (µs|ms)", figure).groups()
        shown_us = float(value) * (1000 if unit == "ms" else 1)
        rounding_us = 0.5 * 10 ** -len(value.partition(".")[2]) * (1000 if unit == "ms" else 1)
        check(abs(shown_us - stage[key]) <= 1.001 * rounding_us, f"shown: {figure}, received {stage[key]} us")
    publisher = received["publisher"]
    check(report["published"]["ring_dropped"] == publisher["ring_dropped"] and report["lost"] == received["lost"] == 0,
          f"drops: {report['published']['ring_dropped']} in the ring and {report['lost']} poses on the page; {publisher['ring_dropped']} and "
          f"{received['lost']} at the subscriber")


def check_first_picture(page, url):
    with urllib.request.urlopen(urllib.request.Request(url + "/", headers={"Accept-Encoding": "gzip, br"})) as answer:
        size, coding = len(answer.read()), answer.headers["Content-Encoding"]
    check(size <= 400 * 1024, f"page: {size / 1024:.0f} KiB ({coding})")
    page.before("(function look() { if (window.nilio?.stage?.drawn > 0) window.firstPicture = performance.now(); else requestAnimationFrame(look); })()")
    page.open(url)
    page.wait("window.firstPicture", 20)
    first = page.run("firstPicture")
    check(first <= 1000, f"first picture with points after {first:.0f} ms")


def resident_mb(child):
    with open(f"/proc/{child.pid}/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def soak(drive, minutes):
    """An HDL-64E at its pace, a minute's drive again and again: neither the page nor the view may grow."""
    drive.simulate("--sensor", "hdl64e", "--realism", "ideal", "--duration", "60")
    view, url = drive.live_view()
    drive.niliod("run", "--set", "lidar.bind_address=127.0.0.1")
    player = drive.start("nilio", "play", f"{drive.folder}/drive", "--restamp", "--loop", "0", log="play.log")
    figures = []
    with Page() as page:
        page.open(url)
        page.wait("window.nilio && nilio.ready && nilio.state.alive", 60)
        for minute in range(minutes + 1):
            heap, nodes = page.heap_bytes()
            # The list of events is bounded and may fill for longer than half the time.
            nodes -= page.run("document.evaluate('count(//ol[@class=\"events\"]//node())', document).numberValue")
            points = float(re.search(r"^nilio_view_map_points (\S+)", get(url + "/metrics")[1], re.M)[1])
            figures.append((heap / 1e6, nodes, resident_mb(view)))
            print(f"      {minute:3d} min: heap {figures[-1][0]:.1f} MB, {nodes} nodes, view {figures[-1][2]:.1f} MB with a map of {points:.0f} points, "
                  f"{page.run('nilio.state.received')} poses", flush=True)
            if minute < minutes:
                time.sleep(60)
        check(player.poll() is None, "packets were sent to the end")
        received = page.run("nilio.state.received")
        check(received > 0.95 * 600 * minutes, f"{received} poses in {minutes} minutes")
        check(not page.errors, f"exceptions on the page: {page.errors}")
    # Charts, lists and the map of the view, which ends at 2 million points, fill up in the first half.
    half = figures[len(figures) // 2:]
    middle = len(half) // 2
    for index, name, allowed in ((0, "heap of the page, MB", 3.0), (1, "nodes of the page", 50), (2, "memory of the view, MB", 3.0)):
        early, late = (max(figure[index] for figure in part) for part in (half[:middle], half[middle:]))
        check(late - early <= allowed, f"{name}: at most {early:.1f}, later {late:.1f}")


class Client:
    """A client of the view without a browser: reads what the page would, as if drawn on another computer."""

    def __init__(self, url):
        host, port = url[7:].split(":")
        self.socket = socket.create_connection((host, int(port)), timeout=5)
        self.socket.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
                            "Sec-WebSocket-Protocol: nilio-view\r\n\r\n".encode())
        self.received = 0
        self.thread = threading.Thread(target=self.read)
        self.thread.start()

    def read(self):
        try:
            while part := self.socket.recv(1 << 18):
                self.received += len(part)
        except OSError:
            pass

    def close(self):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.thread.join()
        self.socket.close()


def compare_latency(drive, runs):
    """Runs at the pace of the sensor, in turn: alone, with a client of the view, and beside a page that draws the map."""
    drive.simulate("--sensor", "vlp16", "--realism", "ideal", "--duration", "30")
    quantiles = {"alone": [], "with a client": [], "beside a page": []}
    for run in range(runs):
        for how, rows in quantiles.items():
            view = client = page = None
            if how != "alone":
                view, url = drive.live_view()
            if how == "with a client":
                client = Client(url)
            if how == "beside a page":
                page = Page()
                page.open(url)
                page.wait("window.nilio", 20)
            output = f"run{run} {how}"
            assert drive.niliod(output).wait(120) == 0
            if client:
                check(client.received > 2e6, f"the client received {client.received / 1e6:.1f} MB")
                client.close()
            if page:
                check(page.run("nilio.stage.drawn") > 1000, f"the page drew {page.run('nilio.stage.drawn')} points")
                page.__exit__()
            if view:
                view.terminate()
                view.wait()
            report = json.load(open(f"{drive.folder}/{output}/latency.json"))
            end, published = report["stages"]["end_to_end"], report["published"]
            written, write = published["received_to_written"], published["write"]
            rows.append([end["p50_us"], end["p99_us"], written["p50_us"], written["p99_us"], write["p50_us"], write["p99_us"]])
    for index, name in enumerate(("pose p50", "pose p99", "written p50", "written p99", "DDS write p50", "DDS write p99")):
        values = {how: sorted(row[index] / 1000 for row in rows) for how, rows in quantiles.items()}
        median = {how: values[how][len(values[how]) // 2] for how in values}
        # Noise: the spread of the runs without a view, half a millisecond at least. The page shares the computer with its browser,
        # which draws without a graphics processor: its figures are printed only.
        noise = max(values["alone"][-1] - values["alone"][0], 0.5)
        check(median["with a client"] <= median["alone"] + noise,
              f"{name}: median " + ", ".join(f"{median[how]:.2f} ms {how} ({values[how][0]:.2f} to {values[how][-1]:.2f})" for how in values))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("programs")
    parser.add_argument("rules")
    parser.add_argument("--screenshots")
    parser.add_argument("--soak", type=int, metavar="MINUTES")
    parser.add_argument("--latency", type=int, metavar="RUNS")
    options = parser.parse_args()
    if not find_chromium():
        print("skipped: chromium is not installed")
        return 77
    folder = tempfile.mkdtemp(prefix="nilio-view-")
    drive = Drive(options.programs, folder)
    try:
        if options.soak or options.latency:
            soak(drive, options.soak) if options.soak else compare_latency(drive, options.latency)
            return 1 if failures else 0
        drive.simulate("--sensor", "vlp16", "--realism", "ideal", "--duration", "70")
        view, url = drive.live_view()
        if "left out" in open(f"{folder}/view.log").read() or "no page" in open(f"{folder}/view.log").read():
            print("skipped: this build has no page")
            return 77
        watch = drive.watch("watch")
        niliod = drive.niliod("run")
        with Page() as page:
            page.open(url)
            page.wait("window.nilio && nilio.ready && nilio.state.alive", 30)
            page.run(KEEP_REPORTS)
            page.wait("nilio.summary && nilio.summary.stages && nilio.state.received > 150", 60)
            check_against_subscriber(page, drive)
            check_first_picture(page, url)
            page.wait("window.nilio && nilio.ready && nilio.state.alive", 30)
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
            check(back < 3, f"poses again {back:.1f} s after the publisher's start")
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

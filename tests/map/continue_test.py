#!/usr/bin/env python3
"""A live run after kill -9 of niliod and nilio-mapper on the way: it completes the map of the killed run, finds itself there
and goes on in its frame; after a run that has ended well nothing is continued.

  continue_test.py FOLDER_OF_PROGRAMS
"""
import math
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

from mapper_child import kill, mapper_of

programs = pathlib.Path(sys.argv[1])
problems = []
PORT = 42368
KILLED_AFTER_M = 90.0


def expect(condition, text):
    if not condition:
        problems.append(text)


def positions(file):
    return [tuple(map(float, line.split()[1:4])) for line in open(file)] if file.exists() else []


def path_length(places):
    return sum(math.dist(a, b) for a, b in zip(places, places[1:]))


def start(log):
    return subprocess.Popen([programs / "niliod", "--output", folder / "run", "--set", "lidar.model=VLP-16", "--set",
                             "lidar.bind_address=127.0.0.1", "--set", f"lidar.port={PORT}", "--set", "lidar.position_port=0",
                             "--set", "imu.enabled=false", "--set", "publisher.enabled=false", "--set",
                             "realtime.lock_memory=false"], stdout=open(log, "w"), stderr=subprocess.STDOUT)


def wait_until(condition, seconds):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.1)
    return condition()


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    subprocess.run([programs / "nilio", "simulate", "--length", "190", "--moving-start", folder / "drive"], check=True,
                   capture_output=True)
    road = positions(folder / "drive/truth.tum")
    first = start(folder / "first.log")
    expect(wait_until(lambda: "UDP 127.0.0.1" in (folder / "first.log").read_text() or first.poll() is not None, 10), "the first run starts")
    player = subprocess.Popen([programs / "nilio", "play", folder / "drive", "--to", "127.0.0.1", "--port", str(PORT),
                               "--restamp"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    before = folder / "run/trajectory.tum"
    expect(wait_until(lambda: path_length(positions(before)) > KILLED_AFTER_M, 60), "the first run drives")
    mapper = mapper_of(first.pid)
    first.kill()
    if mapper:
        kill(mapper)
    first.wait()
    last = positions(before)[-1]
    second = start(folder / "second.log")
    player.wait()
    time.sleep(2.0)
    second.send_signal(signal.SIGTERM)
    second.wait()
    log = (folder / "second.log").read_text()
    expect(f"{folder}/run: was killed; its map is continued" in log, f"the log names the killed run: {log}")
    expect("from the last pose of the earlier run" in log, f"the log says where it found itself: {log}")
    places = positions(folder / "run-2/trajectory_map.tum")
    expect(len(places) > 5, f"{len(places)} poses in the frame of the killed run")
    # The map has the drift of the killed run; farther on the vehicle leaves it.
    beside_road = [min(math.dist(place[:2], other[:2]) for other in road) for place in [last, *places[:20]]]
    expect(max(beside_road) < beside_road[0] + 0.3, f"last pose and poses in the map are {beside_road} m beside the road")
    expect(math.dist(places[0], last) < 25.0, f"the vehicle was at {last}, and is at {places[0]}")
    third = start(folder / "third.log")
    time.sleep(1.0)
    third.send_signal(signal.SIGTERM)
    third.wait()
    expect("was killed" not in (folder / "third.log").read_text(), "a run that has ended well is not continued")

print("\n".join(problems) if problems else "passed")
sys.exit(1 if problems else 0)

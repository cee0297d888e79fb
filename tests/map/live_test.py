#!/usr/bin/env python3
"""Loop closure while a run goes on, in replays of a simulated drive that goes around a block and on: map and corrected
trajectory are those of nilio map close, byte for byte, also after nilio-mapper was killed at drawn instants; the odometry
is that of a run without loop closure.

  live_test.py FOLDER_OF_PROGRAMS [--kills 6] [--seed SEED]
"""
import argparse
import json
import math
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time

from mapper_child import has_begun, kill, mapper_of

parser = argparse.ArgumentParser()
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("--kills", type=int, default=6)
parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
arguments = parser.parse_args()
chance = random.Random(arguments.seed)
problems = []


def expect(condition, text):
    if not condition:
        problems.append(text)


def block(sides, radius):
    """Poses of KITTI's camera (z ahead, x to the right) each metre: straight sides, left turns between them."""
    x = y = heading = 0.0
    turn = round(radius * math.pi / 2)
    for side in sides:
        for i in range(side + turn):
            cosine, sine = math.cos(heading), math.sin(heading)
            yield " ".join(f"{value:.9e}" for value in (cosine, 0, -sine, -y, 0, 1, 0, 0, sine, 0, cosine, x))
            step = math.pi / 2 / turn if i >= side else 0.0
            heading += step
            x, y = x + math.cos(heading - step / 2), y + math.sin(heading - step / 2)


def replay(run, *settings):
    return subprocess.Popen([arguments.programs / "niliod", "--replay", folder / "drive", "--output", run, "--set",
                             "publisher.enabled=false", *settings], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                            text=True)


def finished(niliod):
    """Exit status and log."""
    log = niliod.communicate()[0]
    return niliod.returncode, log


def close(run, log=""):
    """Loops of nilio map close for a copy of the run without loops. A file that the log calls unfinished, because a kill hit
    the process that writes it at the end, has nothing to be compared with; nilio map close writes it."""
    unfinished = {"trajectory_optimised.tum": "trajectory.tum: not corrected", "map.ply": "map.ply: not complete"}
    names = [name for name in ("map/poses", "trajectory_optimised.tum", "map.ply") if unfinished.get(name, "?") not in log]
    copy = folder / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(run, copy)
    for name in names:
        (copy / name).unlink()
    closed = subprocess.run([arguments.programs / "nilio", "map", "close", copy], check=True, capture_output=True, text=True)
    for name in names:
        expect((run / name).read_bytes() == (copy / name).read_bytes(), f"{run.name}: {name} is not that of nilio map close")
    for name in unfinished:
        expect((copy / name).exists(), f"{run.name}: nilio map close has not written {name}")
    return [line.split(",")[0] for line in closed.stdout.splitlines() if line.startswith("loop ")]


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    (folder / "path.txt").write_text("\n".join(block((50, 25, 50, 25, 50, 5), 8)) + "\n")
    subprocess.run([arguments.programs / "nilio", "simulate", "--trajectory", folder / "path.txt", "--pose-interval",
                    "0.125", "--moving-start", "--realism", "ideal", folder / "drive"], check=True, capture_output=True)
    expect(finished(replay(folder / "plain", "--set", "mapper.loops=false"))[0] == 0, "plain: niliod failed")
    expect(not (folder / "plain/map/poses").exists(), "plain: poses in spite of mapper.loops=false")
    trajectory = (folder / "plain/trajectory.kitti").read_bytes()
    begin = time.monotonic()
    expect(finished(replay(folder / "run"))[0] == 0, "run: niliod failed")
    duration = time.monotonic() - begin
    loops = close(folder / "run")
    expect(len(loops) >= 3, f"run: {loops}")
    expect((folder / "run/trajectory.kitti").read_bytes() == trajectory, "run: another odometry than without loop closure")
    counters = json.loads((folder / "run/latency.json").read_text())["counters"]
    expect(counters["mapper_loops"] == len(loops), f"run: {counters['mapper_loops']} loops counted")
    kills = replays = 0
    while kills < arguments.kills and replays < 4 * arguments.kills:
        replays += 1
        run = folder / f"run{replays}"
        niliod = replay(run)
        killed = None
        # The end of a replay starts a mapper three times at most.
        for _ in range(2):
            while niliod.poll() is None and mapper_of(niliod.pid) in (None, killed):
                time.sleep(0.001)
            time.sleep(chance.uniform(0, duration))
            killed = mapper_of(niliod.pid)
            if niliod.poll() is not None or killed is None:
                break
            if not kill(killed):
                continue
            kills += 1
            if has_begun(run):
                read = subprocess.run([arguments.programs / "nilio", "map", "info", run], capture_output=True, text=True)
                expect(read.returncode == 0 and not read.stderr, f"{run.name}: {read.stderr}")
        status, log = finished(niliod)
        expect(status == 0, f"{run.name}: niliod ended with {status}: {log[-500:]}")
        expect((run / "trajectory.kitti").read_bytes() == trajectory, f"{run.name}: another odometry")
        # A kill may cost a keyframe, whose loss moves the submaps: the loops are those of this map.
        expect(len(close(run, log)) >= 3, f"{run.name}: loops are missing")
        shutil.rmtree(run)
    print(f"seed {arguments.seed}: {len(loops)} loops; {kills} kills in {replays} replays of {duration:.1f} s")
for problem in problems:
    print(f"FAILED: {problem}")
sys.exit(bool(problems))

#!/usr/bin/env python3
"""Memory of all processes and size of the map over a long drive around the blocks of a town.

  long_drive.py FOLDER_OF_PROGRAMS [--kilometres 40] [--seed 1] [--sensor vlp16] [--work KEEP] [--loops]
Simulates at --realism typical a drive of seeded turns in a grid of 7.6 km of streets, so that it returns all the time, and
replays it with publisher and mapper. Prints resident memory against the distance and MB of each kilometre. --loops then closes
loops as loops.py does, which takes a quarter of an hour for 40 km.
Exit status 1: a process grew by more than --growth (10) % between half of the drive and its end; 3: a false loop.
"""
import argparse
import json
import pathlib
import random
import subprocess
import sys
import tempfile
import time

import numpy

import loops
from mapper_child import processes_of

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("--kilometres", type=float, default=40)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--sensor", default="vlp16")
parser.add_argument("--growth", type=float, default=10)
parser.add_argument("--work", type=pathlib.Path)
parser.add_argument("--loops", action="store_true")
options = parser.parse_args()
NODES, BLOCK_M = (6, 5), numpy.array([180.0, 130.0])
STEP_M, POSE_INTERVAL_S = 0.5, 0.1037
MAX_SPEED, MAX_LATERAL, MAX_FORWARD = 13.9, 2.0, 1.5  # m/s, m/s^2


def corners():
    """Crossings of a drive that turns where the street was driven least."""
    chance = random.Random(options.seed)
    driven = {}
    nodes = [(0, 0), (1, 0)]
    length = 0.0
    while length < 1000 * options.kilometres:
        (a, b), (x, y) = nodes[-2:]
        streets = [(x + i, y + j) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))
                   if 0 <= x + i < NODES[0] and 0 <= y + j < NODES[1] and (x + i, y + j) != (a, b)]
        following = min(streets, key=lambda n: (driven.get(frozenset((n, (x, y))), 0), chance.random()))
        street = frozenset((following, (x, y)))
        driven[street] = driven.get(street, 0) + 1
        length += BLOCK_M[0] if following[1] == y else BLOCK_M[1]
        nodes.append(following)
    return numpy.array(nodes) * BLOCK_M


def poses():
    """Poses of the drive in KITTI's format: camera axes, x right, y down, z ahead."""
    points = corners()
    along = numpy.concatenate([[0], numpy.cumsum(numpy.linalg.norm(numpy.diff(points, axis=0), axis=1))])
    even = numpy.arange(0.0, along[-1], STEP_M)
    # Corners are cut by the mean over 30 m.
    window = numpy.hanning(61) / numpy.hanning(61).sum()
    path = numpy.stack([numpy.convolve(numpy.pad(numpy.interp(even, along, points[:, i]), 30, mode="edge"), window, "valid")
                        for i in (0, 1)], 1)[60:-60]
    length = numpy.concatenate([[0], numpy.cumsum(numpy.linalg.norm(numpy.diff(path, axis=0), axis=1))])
    heading = numpy.unwrap(numpy.arctan2(*numpy.gradient(path, axis=0).T[::-1]))
    curvature = numpy.abs(numpy.gradient(heading, length))
    speed = numpy.minimum(MAX_SPEED, numpy.sqrt(MAX_LATERAL / numpy.maximum(curvature, 1e-6)))
    for order in (range(1, len(speed)), range(len(speed) - 2, -1, -1)):
        for i in order:
            before = i - 1 if order.step > 0 else i + 1
            speed[i] = min(speed[i], numpy.sqrt(speed[before] ** 2 + 2 * MAX_FORWARD * abs(length[i] - length[before])))
    times = numpy.concatenate([[0], numpy.cumsum(numpy.diff(length) / (0.5 * (speed[1:] + speed[:-1])))])
    at = numpy.arange(0.0, times[-1], POSE_INTERVAL_S)
    x, y, angle = (numpy.interp(at, times, values) for values in (path[:, 0], path[:, 1], heading))
    height = 3 * numpy.sin(x / 140) * numpy.cos(y / 110)
    slope = numpy.gradient(height, numpy.interp(at, times, length))
    ahead = numpy.stack([numpy.cos(angle), numpy.sin(angle), slope], 1) / numpy.sqrt(1 + slope**2)[:, None]
    right = numpy.stack([numpy.sin(angle), -numpy.cos(angle), 0 * angle], 1)
    rows = numpy.zeros((len(at), 3, 4))
    rows[:, :, 0], rows[:, :, 1], rows[:, :, 2] = right, numpy.cross(ahead, right), ahead
    rows[:, :, 3] = numpy.stack([x, y, height], 1)
    # World axes of the format: those of a camera that looks north.
    return (numpy.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]) @ rows).reshape(-1, 12)


def replay(drive, run):
    """Resident memory of the processes by number of submaps, while the drive is replayed."""
    samples = []
    with open(run.with_suffix(".log"), "w") as log:
        niliod = subprocess.Popen([options.programs / "niliod", "--replay", drive, "--output", run, "--force", "--set", "output.run_mcap=false",
                                   "--set", 'publisher.interfaces=["127.0.0.1"]'], stdout=log, stderr=log)
        while niliod.poll() is None:
            sizes = {fields["Name"]: int(fields["VmRSS"].split()[0]) / 1024 for fields in processes_of(niliod.pid).values() if "VmRSS" in fields}
            if "nilio-mapper" in sizes:
                samples.append((len(list((run / "map/submaps").glob("*.sub"))), sizes))
            time.sleep(0.5)
    if niliod.returncode not in (0, 3):
        sys.exit(f"niliod: exit status {niliod.returncode}, see {log.name}")
    return samples


def size_of(folder):
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def main(work):
    drive, run = work / "drive", work / "run"
    if not drive.exists():
        part = drive.with_suffix(".part")
        numpy.savetxt(work / "path.txt", poses(), fmt="%.9e")
        subprocess.run([options.programs / "nilio", "simulate", part, "--sensor", options.sensor, "--trajectory", work / "path.txt",
                        "--pose-interval", str(POSE_INTERVAL_S), "--realism", "typical", "--moving-start"], check=True, stdout=subprocess.DEVNULL)
        part.rename(drive)
    begin = time.monotonic()
    samples = replay(drive, run)
    seconds = time.monotonic() - begin
    kilometres = loops.compare(options.programs, drive / "truth.tum", run / "trajectory.tum")["path"]["truth_m"] / 1000
    names = sorted({name for _, sizes in samples for name in sizes})
    most = samples[-1][0]
    print(f"{kilometres:.1f} km, {most} submaps, replayed in {seconds:.0f} s; resident memory, MiB\n\n| km | " + " | ".join(names) + " |\n" +
          "|---" * (len(names) + 1) + "|")
    # The mean of a tenth of the drive: one sample depends on what a process just did.
    rows = []
    for part in range(10):
        sizes = [s for n, s in samples if part * most <= 10 * n < (part + 1) * most]
        if sizes:
            rows.append({name: numpy.mean([s[name] for s in sizes if name in s] or [numpy.nan]) for name in names})
            print(f"| {(part + 0.5) * kilometres / 10:.1f} | " + " | ".join(f"{rows[-1][name]:.1f}" for name in names) + " |")
    growing = [name for name in names if rows[-1][name] > (1 + options.growth / 100) * rows[len(rows) // 2 - 1][name]]
    counters = json.loads((run / "latency.json").read_text())["counters"]
    states = ", ".join(f"{counters['poses_' + state]} {state}" for state in ("tracking", "degraded", "lost"))
    print(f"\nmap {size_of(run / 'map') / kilometres:.2f} MB/km; keyframes dropped {counters['mapper_keyframes_dropped']}; scans {states}")
    if growing:
        print("grew: " + ", ".join(growing), file=sys.stderr)
    if not options.loops:
        return bool(growing)
    result = loops.evaluate(options.programs, drive / "truth.tum", run)
    loops.report(run.name, result)
    return 3 if any(loop["false"] for loop in result["accepted"]) else bool(growing)


with tempfile.TemporaryDirectory() as temporary:
    folder = options.work or pathlib.Path(temporary)
    folder.mkdir(parents=True, exist_ok=True)
    sys.exit(main(folder))

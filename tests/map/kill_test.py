#!/usr/bin/env python3
"""nilio-mapper killed by kill -9 at drawn instants of replays, while it writes and while it completes the map: after each
kill the folder is a readable map, and the map of the run lacks at most 5 s of the drive in a row.

  kill_test.py FOLDER_OF_PROGRAMS [--kills 100] [--seed SEED] [--length METRES | --drive FOLDER]
--drive: a recording, such as one with loops, instead of a simulated one.
"""
import argparse
import pathlib
import random
import subprocess
import sys
import tempfile
import time

from mapper_child import has_begun, kill, mapper_of

parser = argparse.ArgumentParser()
parser.add_argument("programs", type=pathlib.Path)
parser.add_argument("--kills", type=int, default=100)
parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
parser.add_argument("--length", type=int, default=150)
parser.add_argument("--drive", type=pathlib.Path)
arguments = parser.parse_args()
chance = random.Random(arguments.seed)
problems = []


def replay(drive, run):
    return subprocess.Popen([arguments.programs / "niliod", "--replay", drive, "--output", run, "--set",
                             "publisher.enabled=false", "--set", "output.run_mcap=false"], stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, text=True)


def stamps_of(run, folder):
    """Times of the keyframes in the map."""
    path = folder / "path.tum"
    done = subprocess.run([arguments.programs / "nilio", "map", "export", run / "map", path], capture_output=True,
                          text=True)
    if done.returncode != 0:
        problems.append(f"{run.name}: {done.stderr.strip()}")
        return []
    return [float(line.split()[0]) for line in path.read_text().splitlines()]


with tempfile.TemporaryDirectory() as name:
    folder = pathlib.Path(name)
    drive = arguments.drive or folder / "drive"
    if not arguments.drive:
        subprocess.run([arguments.programs / "nilio", "simulate", "--length", str(arguments.length), "--moving-start",
                        "--seed", str(arguments.seed % 1000), drive], check=True, capture_output=True)
    begin = time.monotonic()
    assert replay(drive, folder / "whole").wait() == 0
    duration = time.monotonic() - begin
    whole = stamps_of(folder / "whole", folder)
    trajectory = (folder / "whole/trajectory.tum").read_bytes()
    kills = replays = 0
    longest = lost = 0
    while kills < arguments.kills and not problems:
        replays += 1
        run = folder / f"run{replays}"
        niliod = replay(drive, run)
        killed = None
        # The end of a replay starts a mapper three times at most: two kills leave one that completes the map.
        for _ in range(2):
            time.sleep(chance.uniform(0, duration / 2))
            while niliod.poll() is None and (mapper_of(niliod.pid) in (None, killed)):
                time.sleep(0.001)
            killed = mapper_of(niliod.pid)
            if niliod.poll() is not None or killed is None:
                break
            time.sleep(chance.uniform(0, 0.1))
            if not kill(killed):
                continue
            kills += 1
            if has_begun(run):
                stamps_of(run, folder)
        log = niliod.communicate()[1]
        if niliod.returncode != 0:
            problems.append(f"{run.name}: niliod ended with {niliod.returncode}: {log[-500:]}")
        if (run / "trajectory.tum").read_bytes() != trajectory:
            problems.append(f"{run.name}: another trajectory")
        missing = sorted(set(whole) - set(stamps_of(run, folder)))
        lost += len(missing)
        # Keyframes in a row that are missing, as the time that they stand for.
        stretch = 0.0
        for before, stamp in zip([whole[0]] + whole, whole):
            stretch = stretch + stamp - before if stamp in missing else 0.0
            longest = max(longest, stretch)
        if longest > 5.0:
            problems.append(f"{run.name}: {longest:.1f} s lost")
    print(f"seed {arguments.seed}: {kills} kills in {replays} replays of {duration:.1f} s, {len(whole)} keyframes each; "
          f"lost {lost} keyframes, at most {longest:.2f} s in a row; every map readable: {not problems}")
for problem in problems:
    print(f"FAILED: {problem}")
sys.exit(bool(problems))

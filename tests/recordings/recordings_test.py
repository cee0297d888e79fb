#!/usr/bin/env python3
"""A simulated drive as ROS bags and MCAP files of independent writers, and run.mcap read by an independent reader.

recordings_test.py PROGRAMS FOLDER     FOLDER keeps the npm packages; exit status: 77 = skipped
"""

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
SECONDS = "14"
failures = []


def check(good, text):
    print(("ok    " if good else "FAILED") + " " + text, flush=True)
    if not good:
        failures.append(text)


def install_packages(folder):
    """The npm packages of package-lock.json beside copies of the scripts; False without node or without a registry."""
    if not shutil.which("npm") or not shutil.which("node"):
        return False
    os.makedirs(folder, exist_ok=True)
    for name in os.listdir(HERE):
        if name.endswith((".mjs", ".json")):
            shutil.copy(os.path.join(HERE, name), folder)
    lock = hashlib.sha256(open(os.path.join(HERE, "package-lock.json"), "rb").read()).hexdigest()
    stamp = os.path.join(folder, "packages.stamp")
    if os.path.exists(stamp) and open(stamp).read() == lock:
        return True
    npm = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"]
    if subprocess.run(npm, cwd=folder, timeout=300).returncode != 0:
        return False
    open(stamp, "w").write(lock)
    return True


class Drive:
    def __init__(self, programs, scripts, folder):
        self.programs, self.scripts, self.folder = programs, scripts, folder

    def path(self, *names):
        return os.path.join(self.folder, *names)

    def run(self, *command, **options):
        return subprocess.run(command, capture_output=True, text=True, timeout=600, **options)

    def replay(self, name, *arguments):
        """Output folder of a replay and what it printed."""
        output = self.path("runs", name)
        done = self.run(f"{self.programs}/niliod", "--replay", *arguments, "--output", output, "--set", "publisher.enabled=false")
        if done.returncode != 0:
            check(False, f"{name}: niliod ends with {done.returncode}: {done.stderr[-600:]}{done.stdout[-600:]}")
        return output, done.stdout + done.stderr

    def recording(self, name, file, configuration):
        """A folder with a bag and a configuration."""
        folder = self.path(name)
        os.makedirs(folder)
        shutil.move(file, folder)
        open(os.path.join(folder, "nilio.yaml"), "w").write(configuration)
        return folder


def read(path):
    with open(path, "rb") as file:
        return file.read()


def poses(path):
    return [[float(value) for value in line.split()] for line in open(path) if not line.startswith("#")]


def end_error(run, truth):
    """Distance between the last pose and the truth, both relative to the first pose, in metres and percent of the path."""
    lines = poses(os.path.join(run, "trajectory.tum"))

    def at(stamp):
        return min(truth, key=lambda pose: abs(pose[0] - stamp))

    def relative(first, last):
        x, y, z, w = first[4:8]
        d = [last[i] - first[i] for i in (1, 2, 3)]
        # The inverse rotation of the first pose.
        x, y, z = -x, -y, -z
        t = [2 * (y * d[2] - z * d[1]), 2 * (z * d[0] - x * d[2]), 2 * (x * d[1] - y * d[0])]
        return [d[0] + w * t[0] + y * t[2] - z * t[1], d[1] + w * t[1] + z * t[0] - x * t[2], d[2] + w * t[2] + x * t[1] - y * t[0]]

    error = math.dist(relative(lines[0], lines[-1]), relative(at(lines[0][0]), at(lines[-1][0])))
    length = sum(math.dist(a[1:4], b[1:4]) for a, b in zip(lines, lines[1:]))
    return error, 100 * error / length


def write_db3(drive, sql, db3):
    with open(sql) as statements:
        subprocess.run(["sqlite3", db3], stdin=statements, check=True, timeout=300)
    os.remove(sql)
    return db3


def check_packets(drive, reference, configuration):
    """Packets and CAN frames of each container give the bits of the capture."""
    expected = read(os.path.join(reference, "trajectory.kitti"))
    files = []
    for compression in ("none", "bz2", "lz4"):
        file = drive.path(f"packets_{compression}.bag")
        done = drive.run("/usr/bin/python3", os.path.join(HERE, "write_rosbag.py"), drive.path("drive"), file, compression)
        if done.returncode == 77:
            print("skipped: rosbag1, python3-rosbag is not installed")
            break
        check(done.returncode == 0, f"python3-rosbag writes {compression} {done.stderr[-300:]}")
        files.append(file)
    files += [drive.path("packets.mcap"), drive.path("packets_plain.mcap")]
    if shutil.which("sqlite3"):
        files.append(write_db3(drive, drive.path("packets.sql"), drive.path("packets.db3")))
    for file in files:
        name = os.path.basename(file)
        run, log = drive.replay(name, drive.recording(name.replace(".", "_"), file, configuration))
        path = os.path.join(run, "trajectory.kitti")
        got = read(path) if os.path.exists(path) else b""
        check(got == expected, f"{name}: {got.count(10)} poses, the same bits as of the capture: {hashlib.sha256(got).hexdigest()[:12]}")


def check_clouds(drive, reference):
    truth = poses(drive.path("drive", "truth.tum"))
    error, percent = end_error(reference, truth)
    print(f"      packets and CAN: end error {error:.4f} m, {percent:.4f} % of the path")
    files = [drive.path("clouds.mcap")]
    if shutil.which("sqlite3"):
        files.append(write_db3(drive, drive.path("clouds.sql"), drive.path("clouds.db3")))
    for file in files:
        name = os.path.basename(file)
        folder = drive.recording(name.replace(".", "_"), file, "recording:\n  base_frame: base_link\n")
        run, log = drive.replay(name, folder)
        got, got_percent = end_error(run, truth)
        check("lidar.extrinsic from /tf_static" in log and "imu.extrinsic from /tf_static" in log, f"{name}: extrinsics of /tf_static")
        # Over so short a path the end error is some millimetres of range noise.
        check(got < 1.05 * error + 0.02, f"{name}: end error {got:.4f} m, {got_percent:.4f} % of the path")
        print("".join(f"      {line.strip()[:200]}\n" for line in log.splitlines() if "times" in line or "beam" in line), end="")
    return drive.path("clouds_mcap", "clouds.mcap")


def check_damage(drive, reference, configuration):
    """Cut and damaged recordings are read as far as they go, and the log names what was skipped."""
    whole = len(poses(os.path.join(reference, "trajectory.tum")))
    clouds = "recording:\n  base_frame: base_link\n"
    for name, settings in (("packets_lz4.bag", configuration), ("packets.mcap", configuration), ("packets.db3", configuration), ("clouds.mcap", clouds)):
        path = drive.path(name.replace(".", "_"), name)
        if not os.path.exists(path):
            continue
        data = read(path)
        middle = len(data) // 2
        for kind, content in (("cut", data[: len(data) * 6 // 10]), ("damaged", data[:middle] + bytes(2000) + data[middle + 2000 :])):
            file = drive.path(f"{kind}_{name}")
            open(file, "wb").write(content)
            run, log = drive.replay(f"{kind}_{name}", drive.recording(f"folder_{kind}_{name}", file, settings))
            kitti = os.path.join(run, "trajectory.tum")
            left = len(poses(kitti)) if os.path.exists(kitti) else 0
            # SQLite has no checksums: zeros in a packet are zeros.
            is_silent = kind == "damaged" and name.endswith(".db3")
            said = is_silent or [line for line in log.splitlines() if "warning" in line and f"{kind}_{name}" in line]
            check(0.3 * whole < left < whole and said, f"{kind} {name}: {left} of {whole} poses; {said[-1][33:233] if said and not is_silent else said}")


def check_choice(drive, bag):
    done = drive.run(f"{drive.programs}/niliod", "--replay", bag, "--output", drive.path("runs", "none"), "--set", "recording.lidar_topic=/lidar")
    text = done.stdout + done.stderr
    check(done.returncode == 1 and "'/lidar' is not in the recording" in text and "/points" in text and " Hz" in text,
          "an unknown topic: the error lists the topics with their rates")
    done = drive.run(f"{drive.programs}/nilio", "inspect", bag)
    check(done.returncode == 0 and "sensor_msgs/PointCloud2" in done.stdout and "/imu/data" in done.stdout, "nilio inspect lists the topics")


def read_run(drive, file, *arguments):
    done = drive.run("node", os.path.join(drive.scripts, "read_run.mjs"), file, *arguments)
    if done.returncode != 0:
        check(False, f"npm's reader reads {os.path.basename(file)}: {done.stderr[-600:]}")
        return None
    return json.loads(done.stdout)


def check_run(drive, run):
    """run.mcap against the other files of the run, whole and cut as after a crash."""
    file = os.path.join(run, "run.mcap")
    found = read_run(drive, file)
    if found is None:
        return
    lines = poses(os.path.join(run, "trajectory.tum"))
    counts = found["counts"]
    print(f"      run.mcap: {os.path.getsize(file) / 1e6:.2f} MB, {found['chunks']} chunks, {counts}")
    check(found["problems"] == [], f"every message decodes, and its definition is the published one {found['problems'][:5]}")
    check(found["statistics"] == counts, f"the statistics count the messages {found['statistics']}")
    check(counts.get("/odom") == len(lines) and counts.get("/tf") == len(lines), f"one pose and transform for each of {len(lines)} lines of trajectory.tum")
    check(counts.get("/scan_registered", 0) > 0.9 * len(lines), f"{counts.get('/scan_registered')} registered scans")
    submaps = len(os.listdir(os.path.join(run, "map", "submaps")))
    check(submaps > 0 and counts.get("/submaps") == submaps, f"{counts.get('/submaps')} of {submaps} submaps")
    check(all(counts.get(topic, 0) > 0 for topic in ("/path", "/diagnostics", "/latency_ms")) and found["pathPoses"] > 5, f"path of {found['pathPoses']} poses")
    position = [found["odometry"][axis] for axis in "xyz"]
    check(math.dist(position, lines[-1][1:4]) < 1e-8, f"the last pose is that of trajectory.tum: {position}")
    check(found["frames"] == {"odom": "odom", "base": "base_link", "tf": "base_link"}, f"frames {found['frames']}")
    check(len(found["diagnostics"]) >= 3, f"diagnostics of {found['diagnostics']}")
    data = read(file)
    cut = drive.path("cut.mcap")
    open(cut, "wb").write(data[: len(data) * 6 // 10])
    part = read_run(drive, cut, "--cut")
    if part is None:
        return
    poses_left = part["counts"].get("/odom", 0)
    check(0 < poses_left < len(lines) and part["problems"] == [], f"a file cut at 60 % gives {poses_left} of {len(lines)} poses")


def check_conversion(drive, run, bag):
    """nilio convert run and nilio convert bag: back from run.mcap, into an MCAP that npm reads, and the scans of a bag."""
    lines = poses(os.path.join(run, "trajectory.tum"))
    tum = drive.path("back.tum")
    done = drive.run(f"{drive.programs}/nilio", "convert", "run", os.path.join(run, "run.mcap"), "--to", "tum", "--output", tum)
    back = poses(tum) if done.returncode == 0 else []
    worst = max((abs(a - b) for one, other in zip(lines, back) for a, b in zip(one[1:], other[1:])), default=None)
    check(len(back) == len(lines) and worst < 1e-8, f"run.mcap as TUM: {len(back)} poses, largest difference {worst} {done.stderr[-200:]}")
    mcap = drive.path("poses.mcap")
    done = drive.run(f"{drive.programs}/nilio", "convert", "run", run, "--to", "mcap", "--output", mcap)
    found = read_run(drive, mcap) if done.returncode == 0 else {"counts": {}, "problems": [done.stderr]}
    check(found["problems"] == [] and found["counts"] == {"/path": 1, "/pose": len(lines), "/tf": len(lines)} and found["pathPoses"] == len(lines),
          f"a run as MCAP: {found['counts']} {found['problems'][:3]}")
    scans = drive.path("scans")
    done = drive.run(f"{drive.programs}/nilio", "convert", "bag", bag, scans, "--format", "csv", "--first", "2", "--count", "3")
    files = sorted(name for name in os.listdir(scans) if name.startswith("scan_")) if done.returncode == 0 else []
    check(files == [f"scan_00000{i}.csv" for i in (2, 3, 4)], f"scans of a bag: {files} {done.stderr[-200:]}")
    if files:
        rows = [line.split(",") for line in open(os.path.join(scans, files[0])).read().splitlines()]
        column = rows[0].index("time")
        times = [float(row[column]) for row in rows[1:]]
        check(len(times) > 1000 and 0.08 < max(times) - min(times) < 0.11, f"{len(times)} points with times over {max(times) - min(times):.4f} s")


def main():
    programs, folder = sys.argv[1:3]
    if not install_packages(folder):
        print("skipped: npm packages cannot be installed")
        return 77
    work = tempfile.mkdtemp(prefix="nilio-recordings-")
    drive = Drive(programs, folder, work)
    try:
        subprocess.run([f"{programs}/nilio", "simulate", drive.path("drive"), "--realism", "ideal", "--duration", SECONDS], check=True, capture_output=True, timeout=600)
        subprocess.run(["node", os.path.join(folder, "write_rosbag2.mjs"), drive.path("drive"), work], check=True, timeout=600)
        reference, _ = drive.replay("capture", drive.path("drive"))
        check_packets(drive, reference, open(drive.path("drive", "nilio.yaml")).read())
        check_run(drive, reference)
        bag = check_clouds(drive, reference)
        check_choice(drive, bag)
        check_conversion(drive, reference, bag)
        check_damage(drive, reference, open(drive.path("drive", "nilio.yaml")).read())
    finally:
        shutil.rmtree(work)
    print(f"{len(failures)} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

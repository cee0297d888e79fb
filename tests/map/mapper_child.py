"""The processes of a niliod, and its nilio-mapper for tests that kill it."""
import os
import pathlib
import signal


def processes_of(niliod):
    """The fields of /proc/PID/status of niliod and its children by PID, those that were started last at the end."""
    processes = {}
    try:
        for pid in (niliod, *map(int, pathlib.Path(f"/proc/{niliod}/task/{niliod}/children").read_text().split())):
            processes[pid] = dict(line.split(":\t", 1) for line in pathlib.Path(f"/proc/{pid}/status").read_text().splitlines())
    except OSError:
        pass
    return processes


def mapper_of(niliod):
    """The nilio-mapper that niliod has started last, or None."""
    return next((pid for pid, fields in reversed(processes_of(niliod).items()) if fields["Name"] == "nilio-mapper" and fields["State"][0] != "Z"), None)


def kill(mapper):
    """Whether it still ran."""
    try:
        os.kill(mapper, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def has_begun(run):
    """Whether the run has a map to read."""
    log = run / "map/map.log"
    return log.exists() and log.stat().st_size > 0

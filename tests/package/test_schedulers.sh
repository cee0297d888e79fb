#!/usr/bin/env bash
# Runs the examples for schedulers as their scheduler would: the tasks of the Slurm array, and the command of the Kubernetes pod, taken
# from the manifest, each over a list of a good recording, a damaged one and no third; then the report over their results.
#   test_schedulers.sh BUILD_FOLDER
set -euo pipefail
source_dir=$(cd "$(dirname "$0")/../.." && pwd)
build=$(realpath "$1")
work=$build/schedulers
examples=$source_dir/tools/examples
export PATH=$build/bin:$PATH
fail() { echo "schedulers: $1" >&2; exit 1; }

python3 -c 'import yaml' 2>/dev/null || { echo "skipped: schedulers: python3-yaml is not installed; tools/setup.sh --tests installs it"; exit 77; }
rm -rf "$work"
mkdir -p "$work"
nilio simulate "$work/good" --sensor vlp16 --imu none --duration 6 >"$work/simulate.txt"
mkdir "$work/damaged"
head -c 20000 /dev/zero >"$work/damaged/lidar.pcap"
printf '%s\n' "$work/good" "$work/damaged" >"$work/list"

# check SCHEDULER COMMAND...: tasks 0 to 2, of which the first succeeds, the second fails and the third has no line.
check() {
  local scheduler=$1 task status expected=(0 1 2)
  shift
  for task in 0 1 2; do
    status=0
    env "SLURM_ARRAY_TASK_ID=$task" "JOB_COMPLETION_INDEX=$task" "LIST=$work/list" "RESULTS=$work/$scheduler" "$@" \
      >"$work/$scheduler-$task.log" 2>&1 || status=$?
    ((status == expected[task])) || { cat "$work/$scheduler-$task.log" >&2; fail "$scheduler: task $task ended with $status, not ${expected[task]}"; }
  done
  grep -q 'has no line 3 - check' "$work/$scheduler-2.log" || fail "$scheduler: task 2 does not say that its line is missing"
  # The damaged recording was refused before anything was written.
  nilio report "$work/$scheduler"/* --format csv >"$work/$scheduler.csv" || fail "$scheduler: nilio report refuses the results"
  grep -q good "$work/$scheduler.csv" || fail "$scheduler: the report lacks the good run"
}

check slurm bash "$examples/slurm_array.sh" "$work/list" "$work/slurm"
python3 - "$examples/kubernetes_job.yaml" >"$work/pod.sh" <<'PYTHON'
import sys, yaml
config_map, job = yaml.safe_load_all(open(sys.argv[1]))
assert config_map["kind"] == "ConfigMap" and (job["apiVersion"], job["kind"]) == ("batch/v1", "Job")
spec = job["spec"]
assert spec["completionMode"] == "Indexed" and spec["completions"] == len(config_map["data"]["list.txt"].split())
pod = spec["template"]["spec"]
(container,) = pod["containers"]
for rule in spec["podFailurePolicy"]["rules"]:
    assert rule.get("onExitCodes", {"containerName": container["name"]})["containerName"] == container["name"]
assert {m["name"] for m in container["volumeMounts"]} == {v["name"] for v in pod["volumes"]}
assert {e["name"] for e in container["env"]} == {"LIST", "RESULTS"}
assert container["command"] == ["sh", "-ec"]
print(container["args"][0])
PYTHON
check kubernetes sh -ec "$(cat "$work/pod.sh")"
cmp "$work"/slurm/*good/trajectory.tum "$work"/kubernetes/*good/trajectory.tum || fail "the schedulers' trajectories differ"
echo "the tasks of both examples ended as documented, with the same trajectory"
rm -rf "$work"/{good,slurm,kubernetes}

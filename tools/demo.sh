#!/usr/bin/env bash
# Sets up, builds, and runs a simulated drive at the pace of the sensor from packets through niliod to poses, with its evaluation.
#   demo.sh [output folder]      NILIO_DEMO_DOMAIN: DDS domain (42), NILIO_DEMO_PRESET: preset to build (release)
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-build/demo}
preset=${NILIO_DEMO_PRESET:-release}
domain=${NILIO_DEMO_DOMAIN:-42}
bin=build/$preset/bin
log=$output/demo.log
mkdir -p "$output"
: >"$log"
children=()
trap 'status=$?; ((${#children[@]} == 0)) || kill "${children[@]}" 2>/dev/null || true; exit $status' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# step TITLE COMMAND...: one line with the time that it took; its output goes to the log, and is shown if it fails. The title counts
# seconds on a terminal.
step() {
  local title=$1 begin=$SECONDS start status=0 child
  shift
  start=$(wc -l <"$log")
  echo "== $title: $*" >>"$log"
  "$@" >>"$log" 2>&1 </dev/null &
  child=$!
  children+=("$child")
  while kill -0 "$child" 2>/dev/null; do
    [[ ! -t 1 ]] || printf '\r  … %-58s %4d s' "$title" $((SECONDS - begin))
    sleep 0.5
  done
  wait "$child" || status=$?
  children=()
  if ((status != 0)); then
    [[ ! -t 1 ]] || printf '\r'
    printf '  ✗ %-58s %4d s\n\n' "$title" $((SECONDS - begin))
    tail -n +"$((start + 1))" "$log" | tail -n 60 >&2
    echo "demo.sh: $title failed with status $status - the whole output is in $log" >&2
    exit "$status"
  fi
  [[ ! -t 1 ]] || printf '\r'
  printf '  ✓ %-58s %4d s\n' "$title" $((SECONDS - begin))
}

drive() {
  "$bin/nilio" watch --domain "$domain" --interface 127.0.0.1 --timeout 30 --json "$output/watch.json" >"$output/watch.txt" 2>&1 &
  local watcher=$! status=0
  "$bin/niliod" --replay "$output/drive" --speed real --output "$output/run" --force --set "publisher.domain=$domain" \
    --set 'publisher.interfaces=["127.0.0.1"]' --set publisher.wait_for_subscribers_s=10 || status=$?
  # End the subscriber now instead of at its time-out, for its summary.
  sleep 1
  kill -INT "$watcher" 2>/dev/null || true
  wait "$watcher" || true
  return "$status"
}

evaluate() {
  "$bin/nilio" evaluate "$output/drive/truth.tum" "$output/run/trajectory.tum" --json "$output/evaluation.json"
  "$bin/nilio" plot "$output/run/trajectory.tum" --truth "$output/drive/truth.tum" --map "$output/run/map.ply" --output "$output/trajectory.png"
}

number() { # number FILE KEY...: a number of a JSON file
  local file=$1 key
  shift
  local text
  text=$(tr -d '\n' <"$file")
  for key in "$@"; do text=${text#*\"$key\":}; done
  [[ $text =~ ^[[:space:]]*(-?[0-9.eE+-]+) ]] && echo "${BASH_REMATCH[1]}"
}

echo "nilio demo; the output of each step is in $log"
step "install what is missing" tools/setup.sh
step "build" tools/build.sh "$preset" niliod nilio-mapper nilio-publisher nilio
step "simulate a town drive with a VLP-16 and an IMU on CAN" "$bin/nilio" simulate "$output/drive" --sensor vlp16
step "drive at the pace of the sensor, published over DDS" drive
step "evaluate against the simulator's ground truth, draw" evaluate

result=$output/run/result.json latency=$output/run/latency.json evaluation=$output/evaluation.json
poses=$(number "$result" poses)
milliseconds() { awk -v us="$1" 'BEGIN { printf "%.1f", us / 1000 }'; }
printf '\n'
printf 'tracked   %s of %s poses over %.1f m\n' "$(number "$result" states tracking)" "$poses" "$(number "$result" path_length_m)"
printf 'drift     %.3f %% at the end, APE %.3f m (RMSE)\n' "$(number "$evaluation" end_drift percent)" "$(number "$evaluation" ape origin translation_m rmse)"
printf 'latency   last packet to DDS written: p50 %s ms, p99 %s ms; to the subscriber: p99 %s ms\n' \
  "$(milliseconds "$(number "$latency" published received_to_written p50_us)")" \
  "$(milliseconds "$(number "$latency" published received_to_written p99_us)")" \
  "$(milliseconds "$(number "$output/watch.json" packet_to_here p99_us)")"
printf 'CPU       %.1f s for %.1f s of drive\n' "$(number "$result" cpu_s)" "$(number "$result" duration_s)"
printf 'look at   %s/trajectory.png, %s/run, %s/drive\n\n' "$output" "$output" "$output"
printf '  %s view %s/run --truth %s/drive/truth.tum\n' "$bin/nilio" "$output" "$output"

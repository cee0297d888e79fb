#!/usr/bin/env bash
# Sets up, builds and runs the tests.
#   test.sh            release build, all tests (those of CAN run inside guests: tests/vm), AddressSanitizer's run of what computes and
#                      decodes, and, unless that took long, ThreadSanitizer's of the daemon and a short run of every fuzz target
#   test.sh --quick    release build and its tests only
#   test.sh --full     nothing is left out; AddressSanitizer runs the tests of the daemon, DDS and the tools, too, which drive for minutes
#                      then; nilio init finds the mountings of a second pair of drives
set -euo pipefail
cd "$(dirname "$0")/.."
case ${1:-} in
  '' | --quick | --full) ;;
  *) echo "test.sh: unknown option $1; known are --quick and --full" >&2; exit 2 ;;
esac
mode=${1:-}
targets=(test_core test_drivers test_ipc test_mapping fuzz_rtps)
selection=(--exclude-regex '^(daemon|dds|tools|map)(_timed)?$')
# Most of these wait for programs that they start: more of them than processors.
untimed=(--label-exclude timed --parallel 4)
if [[ $mode == --full ]]; then
  export NILIO_FULL_TESTS=1
  targets+=(test_daemon test_dds test_tools test_map)
  selection=()
fi
log=build/sanitizers.log
# ThreadSanitizer and the fuzz targets begin within this time, s, or are left out, as on slow computers.
in_time_s=900
# Held during the timed tests.
timed_lock=build/timed.lock

# stage NAME COMMAND...: runs the command and tells how long it took.
stage() {
  local name=$1 start=$SECONDS status=0
  shift
  "$@" || status=$?
  echo "test.sh: $name: $((SECONDS - start)) s"
  return $status
}

run_release_tests() {
  local status=0 results=build/release/Testing/Temporary/LastTest.log
  ctest --preset release "$@" || status=$?
  # Failed checks once more, because logs are long and often cut, and the reasons of skipped tests, which ctest only counts.
  ((status == 0)) || grep --extended-regexp --after-context=4 "FAILED:|^failed:|, not '|^no line '" "$results" | head -n 60 || true
  grep --extended-regexp '^(skipped|undecided):' "$results" || true
  return $status
}

# Sanitizer builds with what the release tests leave of the processors, and their tests, without those of wall-clock times, once the
# timed ones are done.
run_beside_release_tests() {
  stage "asan build" chrt --idle 0 tools/build.sh asan "${targets[@]}" || return
  flock "$timed_lock" true
  stage "asan tests" ctest --preset asan "${untimed[@]}" "${selection[@]}" &
  if [[ $mode != --full ]] && ((SECONDS > in_time_s)); then
    echo "test.sh: left out after $SECONDS s: ThreadSanitizer and the fuzz targets; test.sh --full runs them"
    wait $!
    return
  fi
  stage "tsan build" chrt --idle 0 tools/build.sh tsan test_ipc test_daemon &&
    stage "tsan tests" ctest --preset tsan "${untimed[@]}" --tests-regex '^(ipc|daemon)$' &&
    stage "fuzz build" chrt --idle 0 tools/build.sh fuzz &&
    stage "fuzz tests" ctest --preset fuzz &&
    wait $!
}

stage setup tools/setup.sh --tests
stage "release build" tools/build.sh release
if [[ $mode != --quick ]]; then
  exec {timed_tests}>"$timed_lock"
  flock "$timed_tests"
  # A process group of its own, to end with this script.
  set -m
  run_beside_release_tests >"$log" 2>&1 &
  sanitizers=$!
  set +m
  trap 'kill -- "-$sanitizers" 2>/dev/null || true' EXIT
fi
# Tests of wall-clock times have the computer to themselves but for compilers that run while it is idle.
stage "timed tests" run_release_tests --label-regex timed
[[ $mode == --quick ]] || flock --unlock "$timed_tests"
# The others, above all guests with one processor, run beside the sanitizers.
stage "untimed tests" run_release_tests "${untimed[@]}"
if [[ $mode != --quick ]]; then
  stage "rest of the sanitizers" wait "$sanitizers" || { tail -n 60 "$log"; exit 1; }
  grep --extended-regexp '^test.sh:|tests passed' "$log"
  stage "timed asan tests" ctest --preset asan "${selection[@]}" --label-regex timed
fi

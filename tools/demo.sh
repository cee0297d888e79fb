#!/usr/bin/env bash
# Sets up, builds, and runs a simulated drive from packets through niliod to poses, with its evaluation.
# demo.sh [output folder]
set -euo pipefail
cd "$(dirname "$0")/.."
output=${1:-build/demo}

tools/setup.sh
tools/build.sh release niliod nilio-publisher nilio
bin=build/release/bin

echo
echo "== simulate a town drive with a VLP-16 and an IMU on CAN"
mkdir -p "$output"
"$bin/nilio" simulate "$output/drive" --sensor vlp16

echo
echo "== niliod: packets and CAN frames to poses, published over DDS, with a subscriber listening"
domain=${NILIO_DEMO_DOMAIN:-42}
"$bin/nilio" watch --domain "$domain" --interface 127.0.0.1 --timeout 20 >"$output/watch.txt" 2>&1 &
watcher=$!
"$bin/niliod" --replay "$output/drive" --output "$output/run" --force \
  --set "publisher.domain=$domain" --set 'publisher.interfaces=["127.0.0.1"]' --set publisher.wait_for_subscribers_s=10
# End the subscriber now instead of at its time-out, for its summary.
sleep 1
kill -INT "$watcher" 2>/dev/null || true
wait "$watcher" || true

echo
echo "== poses received by the subscriber over DDS"
tail -n 20 "$output/watch.txt"

echo
echo "== evaluation against the simulator's ground truth"
"$bin/nilio" evaluate "$output/drive/truth.tum" "$output/run/trajectory.tum" --json "$output/evaluation.json"
"$bin/nilio" plot "$output/run/trajectory.tum" --truth "$output/drive/truth.tum" --map "$output/run/map.ply" \
  --output "$output/trajectory.png"

echo
echo "outputs:"
echo "  $output/trajectory.png         trajectory, truth and map"
echo "  $output/run/trajectory.tum     poses"
echo "  $output/run/latency.json       latency by stage and counters"
echo "  $output/evaluation.json        the figures above"
echo "  $output/drive/                 packets (lidar.pcap), CAN log, truth: replay them with niliod --replay $output/drive"

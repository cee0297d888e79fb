#!/usr/bin/env bash
# Slurm array job: one task replays one recording of a list. A task's exit status is that of niliod.
#
#   sbatch --array=0-$(($(wc -l <LIST) - 1))%16 slurm_array.sh LIST RUNS
#   nilio report RUNS/*
#
# LIST has one recording per line, as for niliod --replay. Each task writes to RUNS/<line>-<name of the recording>.
#SBATCH --job-name=nilio
#SBATCH --cpus-per-task=1
#SBATCH --mem=1G
#SBATCH --output=%x-%A_%a.log
set -euo pipefail
list=${1:?usage: slurm_array.sh LIST RUNS} runs=${2:?usage: slurm_array.sh LIST RUNS}
recording=$(sed -n "$((SLURM_ARRAY_TASK_ID + 1))p" "$list")
if [[ -z $recording ]]; then
  echo "$list: has no line $((SLURM_ARRAY_TASK_ID + 1)) - check --array" >&2
  exit 2
fi
# A requeued task meets the files of its first attempt: --force replaces them.
exec niliod --replay "$recording" --output "$runs/$(printf %05d "$SLURM_ARRAY_TASK_ID")-$(basename "$recording")" --force \
  --set publisher.enabled=false --set output.map=false --set odometry.threads="${SLURM_CPUS_PER_TASK:-1}"

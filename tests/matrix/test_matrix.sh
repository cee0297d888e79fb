#!/usr/bin/env bash
# nilio bench matrix --quick against the figures of the last change of them.
#   test_matrix.sh NILIO SOURCE_FOLDER
set -euo pipefail
nilio=$1
source=$2
# Tables of results are not written without their real rows.
if NILIO_DATA=/nonexistent timeout 20 "$source/tools/make_results.py" 2>/dev/null; then
  echo "make_results.py goes on without recordings" >&2
  exit 1
fi
# As the other tests: the recordings beside the repository where NILIO_DATA does not name them.
export NILIO_DATA=${NILIO_DATA:-$source/../shared/data}
exec "$nilio" bench matrix --quick --baseline "$source/docs/results/matrix_quick.json"

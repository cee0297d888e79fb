#!/usr/bin/env bash
# nilio bench matrix --quick against the figures of the last change of them.
#   test_matrix.sh NILIO SOURCE_FOLDER
set -euo pipefail
nilio=$1
source=$2
# As the other tests: the recordings beside the repository where NILIO_DATA does not name them.
export NILIO_DATA=${NILIO_DATA:-$source/../shared/data}
exec "$nilio" bench matrix --quick --baseline "$source/docs/results/matrix_quick.json"

#!/usr/bin/env bash
# The libraries between packets and poses, and those of the map, call no function of the C library whose bits depend on the processor.
#   test_portable_bits.sh ARCHIVE...
set -euo pipefail
functions='sin|cos|tan|sincos|asin|acos|atan|atan2|exp|exp2|expm1|log|log2|log10|log1p|pow|sinh|cosh|tanh'
failed=0
for archive in "$@"; do
  # Single-precision variants end in f.
  found=$(nm --undefined-only --print-file-name "$archive" | grep --extended-regexp " U ($functions)f?(@.*)?$" || true)
  [[ -z $found ]] && continue
  echo "$archive: use nilio/core/portable_math.hpp instead of" >&2
  echo "$found" >&2
  failed=1
done
exit $failed

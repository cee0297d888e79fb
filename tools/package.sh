#!/usr/bin/env bash
# Sets up, builds and packs: build/debs/nilio_*.deb and build/debs/libnilio-dev_*.deb.
set -euo pipefail
cd "$(dirname "$0")/.."
tools/setup.sh
tools/build.sh release
cpack --preset release
rm -rf build/debs/_CPack_Packages
ls -l build/debs/*.deb

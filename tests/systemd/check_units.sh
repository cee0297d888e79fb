#!/usr/bin/env bash
# Checks the units of a folder with systemd-analyze: "verify" prints nothing, the exposure is at most 1.7 (2.0 with CAP_NET_ADMIN), and
# niliod@.service differs from niliod.service in the names of the instance only.
#   check_units.sh FOLDER     exit status: 77 = skipped
set -euo pipefail
command -v systemd-analyze >/dev/null || { echo "skipped: systemd-analyze is not installed (package systemd)"; exit 77; }
units=$(mktemp --directory)
trap 'rm -rf "$units"' EXIT
cp "$1"/*.service "$units"
# The programs are in place only after an installation.
sed -i 's|/usr/bin/niliod|/bin/true|; s|/usr/bin/nilio |/bin/true |; s|/sbin/ip |/bin/true |' "$units"/*.service
cd "$units"
failed=0

verify() {
  local found
  found=$(systemd-analyze verify --man=no --recursive-errors=yes "$@" 2>&1) || true
  [[ -z $found ]] || { printf 'systemd-analyze verify %s:\n%s\n' "$*" "$found"; failed=1; }
}

# at_most TENTHS UNIT
at_most() {
  systemd-analyze security --offline=true --threshold="$1" "$units/$2" | tail -1 || failed=1
}

verify "$units"/niliod.service "$units"/niliod@truck.service "$units"/nilio-can@can0.service "$units"/nilio-view.service
at_most 17 niliod.service
at_most 17 niliod@truck.service
# It serves a port, which niliod does not.
at_most 20 nilio-view.service

# The folder of a drop-in counts: with CAP_NET_ADMIN.
mkdir niliod.service.d
cp "$1/niliod-can.conf" niliod.service.d/
verify "$units"/niliod.service
grep --quiet 'receives ambient capabilities' <(systemd-analyze security --offline=true "$units/niliod.service") ||
  { echo "niliod-can.conf has no effect"; failed=1; }
at_most 20 niliod.service

instance='s|of %i$||; /^ConditionPathExists=/d; s|/etc/nilio/%i.yaml|/etc/nilio/vehicle.yaml|; s|nilio/%i$|nilio|; s| *$||'
diff <(sed "$instance" niliod@.service) niliod.service || { echo "niliod@.service is not niliod.service for an instance"; failed=1; }
exit $failed

#!/usr/bin/env bash
# Checks wording and include directions over the tree; prints file:line and the rule, exit status 1 on a finding.
set -uo pipefail
cd "$(dirname "$0")/.."
# The last part of a pipe runs in this shell, so that report can set failed.
shopt -s lastpipe
failed=0
# report RULE: prints the findings on standard input, if any.
report() { local found; found=$(cat); [[ -z $found ]] || { printf '%s\n  rule: %s\n' "$found" "$1"; failed=1; }; }
prose() { git grep -nIP "$1" -- "${@:2}" ':!LICENSE' ':!config/dbc' ':!tools/check_style.sh'; }

# Comment sentences with a noun as subject.
prose '^\s*(//+|#|\*)\s*(What|Nothing|Of what)\b|(//|^\s*#) .*[.:] (What|Nothing|Of what)\b' '*.cpp' '*.hpp' '*.sh' '*.cmake' '*CMakeLists.txt' '*.yaml' |
  report 'a comment sentence has a noun as subject'
while IFS='|' read -r say not; do
  prose "(?i)$not" . | report "say: $say"
done <<'WORDS'
specific force, velocity increment|\bfelt\b
gravity and accelerometer bias|\bwhat holds it up\b|\bthe support\b
stationary, static initialisation|standing start|\bheld still\b
estimate, update|\blearnt?\b(?! more)|\bunlearn
tracking lost, relocalisation|lost and found|lost (its|the) way|begun anew|\bfinds home\b|\bout of reach\b
moving objects, trucks|\blorr(y|ies)\b|what drives by
degradation level|\brungs?\b
stress load|\bhogs?\b
publish, deliver|\bhand(s|ed|ing)? over\b|\bhand-over\b
wake-up latency|wake-?up noise
limitations|what falls short|does not do yet
layout, architecture|\bthe house\b
check, test, gate|\bis believed\b|\bbelieves\b|\bjudged?\b
WORDS
# Include directions: daemon -> {drivers, ipc} -> core; DDS only in nilio-publisher and the tools.
includes() { git grep -nE "#include \"($1)" -- "${@:2}"; }
includes '(nilio/)?drivers/|ipc/|daemon/|tools/' core | report 'core includes only core'
includes 'ipc/|daemon/|tools/|core/src/' drivers | report 'drivers includes only nilio/core'
includes '(nilio/)?drivers/|mapping/|daemon/|tools/' ipc | report 'ipc includes only core'
includes '(nilio/)?drivers/|ipc/|daemon/|tools/' mapping | report 'mapping includes only core'
includes 'ipc/dds/|mapping/|tools/' daemon ':!daemon/publisher' ':!daemon/mapper' | report 'daemon includes drivers, ipc and core, no DDS'
includes 'core/src/|drivers/|ipc/|daemon/|tools/' core/include drivers/include | report 'public headers include only public headers'
exit $failed

# Turns the text of --help, on standard input, into roff. PART=options prints options and positionals, PART=exit_status
# the last paragraph about the exit status, PART=notes the other paragraphs after the options, PART=commands the names
# and summaries of the subcommands.
function escaped(text) {
  gsub(/\\/, "\\e", text)
  gsub(/-/, "\\-", text)
  sub(/^[.']/, "\\\\\\&&", text)
  return text
}
function first_word(text) { sub(/^ +/, "", text); sub(/ .*/, "", text); return text }
# A line that ends although the next word had room ends there by intention, and so does one before an item of a list.
function broke_by_intention(line, next_line) {
  return length(line) + 1 + length(first_word(next_line)) <= COLUMNS || first_word(next_line) ~ /^[a-z_]+(:|=[A-Z]+)$/
}
# Continuation lines of a description begin at its column.
function is_continuation(text) { return substr(text, 1, COLUMN) == sprintf("%" COLUMN "s", "") && length(text) > COLUMN }
BEGIN { COLUMNS = 100; COLUMN = 30; part = "" }
{ lines[++count] = $0 }
END {
  for (i = 1; i <= count; ++i) {
    line = lines[i]
    if (line ~ /^(Options|Positionals):$/) { part = "options"; continue }
    if (line ~ /^Subcommands:$/) { part = "commands"; continue }
    if (line ~ /^Exit status:/) part = "exit_status"
    else if (line ~ /^[^ ]/ && part != "" && part != "exit_status") part = "notes"
    if (part != PART) continue
    if (part == "options" || part == "commands") item(i)
    else paragraph(i)
  }
}
function item(i,    line, head, text) {
  line = lines[i]
  sub(/ +$/, "", line)
  if (line == "") return
  if (line ~ /^ ? ?[^ ]/) {
    head = line
    text = ""
    is_continued = is_continuation(lines[i + 1])
    if (length(line) > COLUMN && substr(line, COLUMN, 1) == " " &&
        (substr(line, COLUMN - 1, 1) == " " || !is_continued || !broke_by_intention(line, lines[i + 1]))) {
      head = substr(line, 1, COLUMN - 1)
      text = substr(line, COLUMN + 1)
    }
    gsub(/^ +| +$/, "", head)
    name = first_word(head)
    print ".TP"
    print "\\fB" escaped(name) "\\fR" escaped(substr(head, length(name) + 1))
    if (text != "") print escaped(text)
    return
  }
  if (is_continuation(lines[i - 1]) && broke_by_intention(lines[i - 1], line)) print ".br"
  sub(/^ +/, "", line)
  print escaped(line)
}
function paragraph(i,    line) {
  line = lines[i]
  # Indented lines are examples and tables: they keep their columns.
  is_table = line ~ /^ /
  if (is_table && !in_table) print ".nf"
  if (!is_table && in_table) print ".fi"
  in_table = is_table
  if (line == "") { print ".PP"; return }
  print escaped(line)
}

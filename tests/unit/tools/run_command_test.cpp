#include "tests/support/tools/run_command.hpp"

#include <algorithm>
#include <iostream>
#include <sstream>
#include <utility>

#include <CLI/CLI.hpp>

namespace nilio::tests {

namespace {

/// Captures a stream's text in a string while it exists.
class Captured {
 public:
  explicit Captured(std::ostream& stream) : stream_(stream), before_(stream.rdbuf(text_.rdbuf())) {}
  ~Captured() { stream_.rdbuf(before_); }
  Captured(const Captured&) = delete;
  Captured& operator=(const Captured&) = delete;
  [[nodiscard]] std::string text() const { return text_.str(); }

 private:
  std::ostringstream text_;
  std::ostream& stream_;
  std::streambuf* before_;
};

template <class Arguments>
CommandResult capture(AddCommand add_command, Arguments arguments) {
  CLI::App app;
  CommandResult result;
  add_command(app, result.status);
  const Captured output(std::cout);
  const Captured errors(std::cerr);
  try {
    app.parse(std::move(arguments));
  } catch (const CLI::ParseError&) {
    result.status = kNotAccepted;
  }
  result.output = output.text();
  result.errors = errors.text();
  return result;
}

}  // namespace

CommandResult capture_command(AddCommand add_command, std::vector<std::string> arguments) {
  std::reverse(arguments.begin(), arguments.end());
  return capture(add_command, std::move(arguments));
}

CommandResult capture_command(AddCommand add_command, const std::string& line) {
  return capture(add_command, line);
}

int run_command(AddCommand add_command, std::vector<std::string> arguments) {
  return capture_command(add_command, std::move(arguments)).status;
}

}  // namespace nilio::tests

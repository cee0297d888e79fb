#pragma once

#include <string>
#include <sys/types.h>

namespace nilio::tests {

/// Standard output of a shell command, without the newline at its end.
std::string output_of(const std::string& command);

/// A unit of the guest's systemd.
class ServiceUnit {
 public:
  explicit ServiceUnit(std::string name) : name_(std::move(name)) {}

  /// Exit status of "systemctl VERB UNIT".
  [[nodiscard]] int control(const std::string& verb) const;
  /// Value of a property, such as ActiveState.
  [[nodiscard]] std::string property(const std::string& name) const;
  /// True once the property matches the pattern (ECMAScript).
  [[nodiscard]] bool await(const std::string& property, const std::string& pattern) const;
  [[nodiscard]] bool is_active() const { return property("ActiveState") == "active"; }
  [[nodiscard]] pid_t main_pid() const;
  [[nodiscard]] int restarts() const;
  /// Messages in the journal; `options` of journalctl.
  [[nodiscard]] std::string journal(const std::string& options = "") const;
  /// True once a line of the journal matches the pattern.
  [[nodiscard]] bool has_line(const std::string& pattern) const;
  /// Replaces the unit's drop-in by these lines of [Service]; empty: none.
  void configure(const std::string& lines) const;

 private:
  [[nodiscard]] std::string end_of_journal() const;

  std::string name_;
};

}  // namespace nilio::tests

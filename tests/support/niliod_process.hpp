#pragma once

#include "tests/support/eventually.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/test_domain.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <regex>
#include <string>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace nilio::tests {

inline std::size_t count_lines(const std::filesystem::path& path) {
  const std::string text = read_file(path);
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

inline const std::string kNoPublisher = "publisher.enabled=false";

/// Setting of a DDS domain, isolated from other programs on the machine.
inline std::string own_domain() { return "publisher.domain=" + std::to_string(test_domain()); }

struct FinishedProcess {
  int status = -1;  ///< exit status, or minus the signal
  std::string output;
};

/// niliod with both output streams redirected to a file.
class NiliodProcess {
 public:
  using Environment = std::vector<std::pair<std::string, std::string>>;

  NiliodProcess(const TemporaryFolder& folder, const std::vector<std::string>& arguments,
                const Environment& environment = {},
                const std::filesystem::path& program = std::filesystem::path(program_folder()) / "niliod")
      : log_(folder.path() / "niliod.log") {
    std::vector<std::string> words{program.string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    pid_ = fork();
    if (pid_ == 0) {
      for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
      std::vector<char*> argv;
      for (std::string& word : words) argv.push_back(word.data());
      argv.push_back(nullptr);
      if (freopen(log_.c_str(), "w", stdout) == nullptr || dup2(STDOUT_FILENO, STDERR_FILENO) < 0) _exit(126);
      execv(argv[0], argv.data());
      _exit(127);
    }
  }
  [[nodiscard]] std::string output() const { return read_file(log_); }
  [[nodiscard]] pid_t pid() const { return pid_; }
  FinishedProcess wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), output()};
  }
  /// Waits until the pattern matches the output; returns its first group, or an empty text.
  [[nodiscard]] std::string await(const std::string& pattern) const {
    const std::regex expression(pattern);
    std::string found;
    eventually([&] {
      const std::string text = output();
      std::smatch match;
      if (!std::regex_search(text, match, expression)) return false;
      found = match[1].str();
      return true;
    });
    return found;
  }

 private:
  std::filesystem::path log_;
  pid_t pid_ = -1;
};

}  // namespace nilio::tests

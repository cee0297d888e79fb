#include "tests/vm/service_unit.hpp"

#include "tests/vm/vm_support.hpp"

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <regex>

#include <catch2/catch.hpp>

namespace nilio::tests {

std::string output_of(const std::string& command) {
  std::string text;
  std::FILE* const pipe = popen(command.c_str(), "r");
  REQUIRE(pipe != nullptr);
  std::array<char, 4096> buffer{};
  while (const std::size_t size = std::fread(buffer.data(), 1, buffer.size(), pipe))
    text.append(buffer.data(), size);
  pclose(pipe);
  while (text.ends_with('\n')) text.pop_back();
  return text;
}

int ServiceUnit::control(const std::string& verb) const {
  return shell("systemctl " + verb + " '" + name_ + "'");
}

std::string ServiceUnit::property(const std::string& name) const {
  return output_of("systemctl show --value --property=" + name + " '" + name_ + "'");
}

bool ServiceUnit::await(const std::string& name, const std::string& pattern) const {
  const std::regex expression(pattern);
  if (eventually([&] { return std::regex_search(property(name), expression); })) return true;
  std::cout << name << " is '" << property(name) << "', not '" << pattern << "'\n" << end_of_journal();
  return false;
}

pid_t ServiceUnit::main_pid() const { return static_cast<pid_t>(std::stol(property("MainPID"))); }

int ServiceUnit::restarts() const { return std::stoi(property("NRestarts")); }

std::string ServiceUnit::journal(const std::string& options) const {
  return output_of("journalctl --no-pager --quiet --output=cat --unit='" + name_ + "' " + options);
}

bool ServiceUnit::has_line(const std::string& pattern) const {
  const std::regex expression(pattern);
  if (eventually([&] { return std::regex_search(journal(), expression); })) return true;
  std::cout << "no line '" << pattern << "'\n" << end_of_journal();
  return false;
}

std::string ServiceUnit::end_of_journal() const {
  return "end of the journal:\n" + journal("--lines=30") + "\n";
}

void ServiceUnit::configure(const std::string& lines) const {
  const std::filesystem::path folder = "/etc/systemd/system/" + name_ + ".service.d";
  std::filesystem::create_directories(folder);
  std::ofstream(folder / "test.conf") << "[Service]\n" << lines;
  REQUIRE(shell("systemctl daemon-reload") == 0);
}

}  // namespace nilio::tests

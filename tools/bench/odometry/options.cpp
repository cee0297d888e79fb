#include "tools/bench/odometry/options.hpp"

#include "tools/commands/number_between.hpp"

#include <cstdio>
#include <unistd.h>

namespace nilio::tools {

namespace {

/// Others' domains are small numbers; two benches at a time are to hear each other no more than them.
constexpr int kFirstDomain = 100;
constexpr int kDomains = 100;

}  // namespace

void add_override_option(CLI::App& command, std::vector<std::string>& overrides,
                         const std::string& description) {
  command.add_option("--set", overrides, description)->take_all()->expected(1);
}

void add_domain_option(CLI::App& command, std::uint32_t& domain) {
  domain = static_cast<std::uint32_t>(kFirstDomain + getpid() % kDomains);
  command.add_option("--domain", domain, "DDS domain id (default: one of 100 to 199)")
      ->check(number_between(0.0, 232.0));
}

void end_bench(const CLI::App& command, const core::Result<bool>& good) {
  if (good && *good) return;
  if (!good)
    std::fprintf(stderr, "nilio bench %s: %s\n", command.get_name().c_str(), good.error().message.c_str());
  throw CLI::RuntimeError(1);
}

void end_bench(const CLI::App& command, const core::Result<std::monostate>& done) {
  end_bench(command, done ? core::Result<bool>(true) : core::Result<bool>(done.error()));
}

}  // namespace nilio::tools

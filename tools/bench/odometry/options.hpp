#pragma once

#include "nilio/core/result.hpp"

#include "tools/commands/command_line_fwd.hpp"

#include <cstdint>
#include <string>
#include <variant>
#include <vector>

namespace nilio::tools {

/// --set, for "key=value" of the configuration.
void add_override_option(CLI::App& command, std::vector<std::string>& overrides,
                         const std::string& description);

/// --domain; `domain` becomes one that is likely to be unused.
void add_domain_option(CLI::App& command, std::uint32_t& domain);

/// Ends the parsing with CLI::RuntimeError when a bench failed, having said why, or found what should not be
/// (false).
void end_bench(const CLI::App& command, const core::Result<bool>& good);
void end_bench(const CLI::App& command, const core::Result<std::monostate>& done);

}  // namespace nilio::tools

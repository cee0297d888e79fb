#pragma once

#include <span>
#include <string_view>

namespace nilio::drivers {

/// A file of config/dbc, made part of the library at build time.
struct EmbeddedDbc {
  std::string_view name;
  std::string_view text;
};

std::span<const EmbeddedDbc> embedded_dbc_files();

}  // namespace nilio::drivers

#include "daemon/config/schema.hpp"

#include <cinttypes>
#include <cstdint>
#include <cstdio>

namespace nilio::daemon {

namespace {

/// FNV-1a (Fowler, Noll, Vo), 64 bit.
class Fnv1a {
 public:
  void add(const std::string& text) {
    for (const char c : text) hash_ = (hash_ ^ static_cast<unsigned char>(c)) * 0x00000100000001b3U;
  }
  [[nodiscard]] std::string hex() const {
    char digits[17];
    std::snprintf(digits, sizeof digits, "%016" PRIx64, hash_);
    return digits;
  }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325U;
};

}  // namespace

std::vector<ConfigChange> find_changes(const Config& from, const Config& to) {
  Config old_config = from;
  Config new_config = to;
  const std::vector<ConfigKey> old_keys = config_keys(old_config);
  const std::vector<ConfigKey> new_keys = config_keys(new_config);
  std::vector<ConfigChange> changes;
  for (std::size_t i = 0; i < new_keys.size(); ++i) {
    ConfigChange change{new_keys[i].path, value_text(old_keys[i]), value_text(new_keys[i]),
                        new_keys[i].reload};
    if (change.from != change.to) changes.push_back(std::move(change));
  }
  return changes;
}

std::string config_hash(const Config& config) {
  Config values = config;
  Fnv1a hash;
  for (const ConfigKey& key : config_keys(values)) hash.add(key.path + ": " + value_text(key) + "\n");
  return hash.hex();
}

}  // namespace nilio::daemon

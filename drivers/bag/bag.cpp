#include "nilio/drivers/bag/bag.hpp"

#include "drivers/bag/decompress.hpp"
#include "drivers/bag/readers.hpp"
#include "drivers/bag/topic_table.hpp"

#include <algorithm>
#include <array>
#include <exception>
#include <filesystem>
#include <limits>
#include <set>
#include <string_view>
#include <utility>

#include <yaml-cpp/yaml.h>

namespace nilio::drivers {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using namespace std::string_view_literals;

constexpr std::uintmax_t kMaxMetadata = std::uintmax_t{16} << 20U;
constexpr std::size_t kMaxFiles = 10'000;

enum class Format : std::uint8_t { kRosbag1, kDb3, kMcap, kOther };

Format format_of(const std::string& path) {
  const auto file = bag::open_file(path);
  if (!file) return Format::kOther;
  std::vector<std::uint8_t> head;
  (*file)->read_all(0, 16, head);
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
  if (text.starts_with("#ROSBAG V")) return Format::kRosbag1;
  if (text.starts_with("SQLite format 3\0"sv)) return Format::kDb3;
  return text.starts_with("\x89MCAP") ? Format::kMcap : Format::kOther;
}

bool is_compressed_bag(const fs::path& path) {
  const std::string inner = path.stem().extension().string();
  return path.extension() == ".zstd" && (inner == ".db3" || inner == ".mcap");
}

Result<std::unique_ptr<BagReader>> open_one(const std::string& path, BagReader::Filter filter) {
  const Format format = format_of(path);
  if (format == Format::kDb3) return bag::open_db3(path, std::move(filter));
  auto file = bag::open_file(path);
  if (!file) return file.error();
  if (format == Format::kRosbag1) return bag::open_rosbag1(std::move(file).value(), std::move(filter));
  if (format == Format::kMcap) return bag::open_mcap(std::move(file).value(), std::move(filter));
  return Error{path + ": is no ROS bag (rosbag1, db3 or MCAP)"};
}

/// Paths that metadata.yaml names; empty if it names none.
Result<std::vector<std::string>> files_of_metadata(const fs::path& folder) {
  const fs::path metadata = folder / "metadata.yaml";
  std::error_code code;
  if (!fs::exists(metadata, code)) return std::vector<std::string>{};
  if (fs::file_size(metadata, code) > kMaxMetadata || code)
    return Error{metadata.string() + ": is larger than 16 MiB - remove it to read the files beside it"};
  std::vector<std::string> files;
  try {
    const YAML::Node paths =
        YAML::LoadFile(metadata.string())["rosbag2_bagfile_information"]["relative_file_paths"];
    for (std::size_t i = 0; i < std::min(paths.size(), kMaxFiles); ++i) {
      const fs::path path = paths[i].as<std::string>();
      const bool leaves = path.is_absolute() || std::find(path.begin(), path.end(), "..") != path.end();
      if (leaves)
        return Error{metadata.string() + ": relative_file_paths names '" + path.string() +
                     "' outside of its folder - correct it"};
      // Before version 4 the paths begin with the name of the folder.
      files.push_back(
          (fs::exists(folder / path, code) ? folder / path : folder.parent_path() / path).string());
    }
  } catch (const std::exception& exception) {
    return Error{metadata.string() + ": cannot be read as YAML (" + exception.what() +
                 ") - remove it to read the files beside it"};
  }
  return files;
}

Result<std::vector<std::string>> files_in_folder(const fs::path& folder) {
  std::vector<std::string> files;
  std::error_code code;
  for (fs::directory_iterator entry(folder, code), end; !code && entry != end; entry.increment(code)) {
    if (!entry->is_regular_file(code)) continue;
    const fs::path& path = entry->path();
    if (is_compressed_bag(path) || format_of(path.string()) != Format::kOther) files.push_back(path.string());
  }
  if (code) return Error{folder.string() + ": cannot be read (" + code.message() + ")"};
  std::sort(files.begin(), files.end());
  const std::set<Format> formats = [&] {
    std::set<Format> found;
    for (const std::string& file : files) found.insert(format_of(file));
    return found;
  }();
  if (formats.size() > 1)
    return Error{folder.string() + ": holds bags of several formats - name the files to read"};
  return files;
}

/// Parts of one recording, one after the other.
class ChainedBag : public BagReader {
 public:
  ChainedBag(std::vector<std::string> files, Filter filter)
      : files_(std::move(files)), filter_(std::move(filter)), table_(filter_) {}

  std::optional<BagMessage> next() override {
    for (;;) {
      if (!reader_) {
        if (next_file_ == files_.size()) return std::nullopt;
        open_next();
        continue;
      }
      std::optional<BagMessage> message = reader_->next();
      add_topics();
      if (message) {
        const std::optional<std::size_t> topic = topic_of_[message->topic];
        if (!topic) continue;
        message->topic = *topic;
        return message;
      }
      for (const std::string& note : reader_->notes()) table_.note(note);
      reader_.reset();
    }
  }
  [[nodiscard]] const std::vector<BagTopic>& topics() const override { return table_.topics(); }
  [[nodiscard]] const std::vector<std::string>& notes() const override { return table_.notes(); }

 private:
  void open_next() {
    const std::string& path = files_[next_file_++];
    topic_of_.clear();
    auto opened = open_one(path, filter_);
    if (!opened) {
      table_.note(opened.error().message + "; the file is skipped");
      return;
    }
    reader_ = std::move(opened).value();
  }
  void add_topics() {
    const std::vector<BagTopic>& topics = reader_->topics();
    while (topic_of_.size() < topics.size()) topic_of_.push_back(table_.add(topics[topic_of_.size()]));
  }

  std::vector<std::string> files_;
  Filter filter_;
  bag::TopicTable table_;
  std::unique_ptr<BagReader> reader_;
  std::size_t next_file_ = 0;
  std::vector<std::optional<std::size_t>> topic_of_;
};

}  // namespace

bool is_bag(const std::string& path) {
  std::error_code code;
  if (!fs::is_directory(path, code))
    return fs::is_regular_file(path, code) && format_of(path) != Format::kOther;
  if (fs::exists(fs::path(path) / "metadata.yaml", code)) return true;
  for (fs::directory_iterator entry(path, code), end; !code && entry != end; entry.increment(code)) {
    if (!entry->is_regular_file(code)) continue;
    if (is_compressed_bag(entry->path()) || format_of(entry->path().string()) != Format::kOther) return true;
  }
  return false;
}

Result<std::vector<std::string>> bag_files(const std::string& path) {
  std::error_code code;
  std::vector<std::string> files{path};
  if (fs::is_directory(path, code)) {
    auto named = files_of_metadata(path);
    if (!named) return named.error();
    files = std::move(named).value();
    if (files.empty()) {
      auto found = files_in_folder(path);
      if (!found) return found.error();
      files = std::move(found).value();
    }
    if (files.empty()) return Error{path + ": holds no bag file (.bag, .db3, .mcap)"};
  }
  for (const std::string& file : files) {
    if (is_compressed_bag(file))
      return Error{file + ": is compressed as a whole (compression mode FILE) - unpack it with 'unzstd " +
                   file + "', then name the unpacked files"};
    if (!fs::exists(file, code)) return Error{file + ": does not exist; metadata.yaml names it"};
  }
  return files;
}

Result<std::unique_ptr<BagReader>> open_bag(const std::vector<std::string>& files, BagReader::Filter filter) {
  if (files.empty()) return Error{"bag: no file is named"};
  if (files.size() == 1) return open_one(files.front(), std::move(filter));
  // Parts are not named in their order: name_10.bag sorts before name_2.bag.
  std::vector<std::pair<core::Time, std::string>> parts;
  for (const std::string& file : files) {
    auto reader = open_one(file, {});
    if (!reader) return reader.error();
    const auto first = (*reader)->next();
    parts.emplace_back(first ? first->stamp : core::Time{std::numeric_limits<std::int64_t>::max()}, file);
  }
  std::stable_sort(parts.begin(), parts.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::string> sorted;
  for (auto& [time, file] : parts) sorted.push_back(std::move(file));
  return std::unique_ptr<BagReader>(std::make_unique<ChainedBag>(std::move(sorted), std::move(filter)));
}

}  // namespace nilio::drivers

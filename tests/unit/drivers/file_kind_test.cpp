#include "nilio/drivers/capture/file_kind.hpp"

#include "tests/support/temporary_folder.hpp"

#include <catch2/catch.hpp>

using namespace nilio::drivers;
using nilio::tests::TemporaryFolder;

namespace {

const std::string kCapture("\xD4\xC3\xB2\xA1 and so on", 14);
const std::string kCanLine = "(1700000000.123456) can0 034#0000000009CF\n";

}  // namespace

TEST_CASE("recorded files are recognised by their content, whatever their name", "[file_kind]") {
  const TemporaryFolder folder;
  CHECK(file_kind(folder.write("capture.dat", kCapture)) == FileKind::kCapture);
  CHECK(file_kind(folder.write("capture", "\x0A\x0D\x0D\x0A....")) == FileKind::kCapture);
  CHECK(file_kind(folder.write("can.txt", "a comment\n" + kCanLine)) == FileKind::kCanLog);
  CHECK(file_kind(folder.write("can.pcap", kCanLine)) == FileKind::kCanLog);
  CHECK(file_kind(folder.write("niliod.log", "no frame at all\n")) == FileKind::kOther);
  CHECK(file_kind(folder.write("notes.txt", "")) == FileKind::kOther);
  CHECK(file_kind(folder.text()) == FileKind::kOther);
  CHECK(file_kind(folder.file("missing")) == FileKind::kOther);
}

TEST_CASE("a damaged file counts by its name, an unfinished one not at all", "[file_kind]") {
  const TemporaryFolder folder;
  CHECK(file_kind(folder.write("damaged.pcap", "damaged")) == FileKind::kCapture);
  CHECK(file_kind(folder.write("empty.candump", "")) == FileKind::kCanLog);
  const std::string unfinished = folder.write("lidar.pcap.partial", kCapture);
  CHECK(file_kind(unfinished) == FileKind::kOther);
  CHECK(why_no_recording(unfinished).find("interrupted") != std::string::npos);
  CHECK(why_no_recording(folder.write("a.gz", "\x1F\x8B....")).find("gunzip") != std::string::npos);
}

TEST_CASE("a packed recording is recognised and named with the command that unpacks it", "[file_kind]") {
  const TemporaryFolder folder;
  const std::string packed = folder.write("lidar.pcap.gz", "\x1F\x8B....");
  CHECK(file_kind(packed) == FileKind::kCompressed);
  CHECK(file_kind(folder.write("can.log.xz",
                               "\xFD"
                               "7zXZ....")) == FileKind::kCompressed);
  CHECK(file_kind(folder.write("notes.tar.gz", "\x1F\x8B....")) == FileKind::kOther);
  for (const char* const name : {"drive_0.db3.zstd", "drive_0.mcap.zstd", "drive.bag.gz"})
    CHECK(file_kind(folder.write(name, "\x28\xB5\x2F\xFD...")) == FileKind::kCompressed);
  CHECK(why_no_recording(packed) == "is compressed (gzip); unpack it with 'gunzip " + packed + "'");
}

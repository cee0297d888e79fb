#include "nilio/drivers/can/dbc/dbc.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/imu_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::dbc_error;

namespace {

using Bytes = std::vector<std::uint8_t>;

/// The only signal of a message of 8 bytes, laid out as in a DBC file: "7|16@0-".
DbcSignal signal_of(const std::string& layout, const std::string& scaling = "(1,0)") {
  const auto database =
      parse_dbc("BO_ 1 M: 8 X\n SG_ s : " + layout + " " + scaling + " [0|0] \"\" X\n", "t.dbc");
  REQUIRE(database.ok());
  return database->messages[0].signals[0];
}

}  // namespace

TEST_CASE("raw values follow the DBC bit numbering", "[dbc]") {
  const Bytes payload{0x12, 0x34, 0x56, 0x78, 0x90, 0xAB, 0xCD, 0xEF};
  const std::vector<std::pair<const char*, std::int64_t>> cases{
      {"0|16@1+", 13330},
      {"8|16@1+", 22068},
      {"4|8@1+", 65},
      {"12|12@1+", 1379},
      {"32|16@1-", -21616},
      {"7|16@0+", 4660},
      {"15|16@0+", 13398},
      {"7|12@0+", 291},
      {"3|12@0+", 564},
      {"39|16@0-", -28501},
      {"31|8@0+", 0x78},
      {"55|16@0-", -12817},
      {"0|64@1+", static_cast<std::int64_t>(0xEFCDAB9078563412)},
      {"7|64@0+", 0x1234567890ABCDEF}};
  for (const auto& [layout, expected] : cases) {
    CAPTURE(layout);
    const DbcSignal signal = signal_of(layout);
    CHECK(decode_raw(signal, payload) == expected);
    // Writing the value onto ones and onto zeros changes the signal's bits only.
    for (const std::uint8_t background : Bytes{0x00, 0xFF}) {
      Bytes written(8, background);
      if (signal.length == 64) continue;  // beyond the precision of a double
      REQUIRE(encode_physical(signal, static_cast<double>(expected), written));
      CHECK(decode_raw(signal, written) == expected);
      Bytes cleared = written;
      REQUIRE(encode_physical(signal, background == 0 ? 0.0 : (signal.is_signed ? -1.0 : 1e9), cleared));
      CHECK(cleared == Bytes(8, background));
    }
  }
}

TEST_CASE("a payload shorter than a signal has no value", "[dbc]") {
  const Bytes payload{0x12, 0x34, 0x56};
  CHECK(decode_raw(signal_of("7|16@0+"), payload).has_value());
  CHECK_FALSE(decode_raw(signal_of("23|16@0+"), payload).has_value());
  CHECK_FALSE(decode_physical(signal_of("16|16@1+"), payload).has_value());
  CHECK_FALSE(decode_raw(signal_of("65000|64@1+"), payload).has_value());
  Bytes short_payload(1);
  CHECK_FALSE(encode_physical(signal_of("7|16@0+"), 1.0, short_payload));
}

TEST_CASE("physical values are scaled, rounded to nearest and saturated", "[dbc]") {
  const DbcSignal yaw_rate = signal_of("51|12@0-", "(0.0625,0)");
  Bytes payload(8);
  REQUIRE(encode_physical(yaw_rate, -1.0, payload));
  CHECK(payload == Bytes{0, 0, 0, 0, 0, 0, 0x0F, 0xF0});
  CHECK(decode_physical(yaw_rate, payload) == -1.0);
  REQUIRE(encode_physical(yaw_rate, 1e30, payload));
  CHECK(decode_raw(yaw_rate, payload) == 2047);
  REQUIRE(encode_physical(yaw_rate, -1e30, payload));
  CHECK(decode_raw(yaw_rate, payload) == -2048);
  CHECK_FALSE(encode_physical(yaw_rate, std::nan(""), payload));

  const DbcSignal unsigned64 = signal_of("0|64@1+");
  REQUIRE(encode_physical(unsigned64, 1e300, payload));
  CHECK(payload == Bytes(8, 0xFF));
  CHECK(decode_physical(unsigned64, payload) == Approx(1.8446744073709552e19));
  const DbcSignal signed64 = signal_of("7|64@0-");
  REQUIRE(encode_physical(signed64, -1e300, payload));
  CHECK(payload == Bytes{0x80, 0, 0, 0, 0, 0, 0, 0});
}

TEST_CASE("floating-point signals hold their value unchanged", "[dbc]") {
  const auto database = parse_dbc(
      "BO_ 25 Acc: 8 X\n SG_ x : 7|32@0- (1,0) [0|0] \"\" X\n SG_ y : 39|32@0- (1,0) [0|0] \"\" X\n"
      "SIG_VALTYPE_ 25 x : 1;\nSIG_VALTYPE_ 25 y : 1;\n",
      "t.dbc");
  REQUIRE(database.ok());
  const DbcSignal* y = database->find("Acc", "y");
  REQUIRE(y != nullptr);
  const Bytes payload{0, 0, 0, 0, 0xC1, 0x1C, 0xF5, 0xC3};
  CHECK(decode_physical(*y, payload) == Approx(-9.81));
  Bytes written(8);
  REQUIRE(encode_physical(*y, static_cast<double>(-9.81F), written));
  CHECK(written == payload);
}

TEST_CASE("statements of real files are read or skipped", "[dbc]") {
  const auto database = parse_dbc(
      "\xEF\xBB\xBFVERSION \"1;2\"\r\nNS_ :\r\n\tCM_\r\n\tBA_\r\n\tSIG_VALTYPE_\r\nBS_:\r\nBU_: A B\r\n"
      "VAL_TABLE_ t 1 \"one\" 0 \"zero\" ;\r\n"
      "BO_ 2566834942 Ext: 8 A\r\n SG_ Mode M : 0|4@1+ (1,0) [0|0] \"\" B\r\n"
      " SG_ Value m1 : 8|16@1- (1E-005,+3) [-1.5E2|+2] \"\xB0/s\" A,B\r\n"
      " SG_ Both m2M:24|8@0+ (2,0) [0|0] \"\" Vector__XXX\r\n"
      "BO_ 3221225472 VECTOR__INDEPENDENT_SIG_MSG: 0 X\r\n SG_ Lost : 0|8@1+ (1,0) [0|0] \"\" X\r\n"
      "BO_ 100 Empty: 0 X\r\n"
      "CM_ SG_ 100 Value \"two lines; with a semicolon\r\nBO_ 7 NotAMessage: 8 X and a \\\" quote\";\r\n"
      "FUTURE_KEYWORD_ 1 2 3;\r\nBA_DEF_ BO_ \"Cycle\" INT 0 1000;\r\nBA_ \"Cycle\" BO_ 100 10;\r\n",
      "t.dbc");
  REQUIRE(database.ok());
  REQUIRE(database->messages.size() == 2);
  const DbcMessage& message = database->messages[0];
  CHECK(message.extended);
  CHECK(message.id == (2566834942U & 0x1FFFFFFFU));
  REQUIRE(message.signals.size() == 3);
  CHECK_FALSE(message.signals[0].multiplexed);
  CHECK(message.signals[1].multiplexed);
  CHECK(message.signals[1].factor == 1e-5);
  CHECK(message.signals[1].offset == 3.0);
  CHECK(message.signals[1].minimum == -150.0);
  CHECK(message.signals[1].unit == "\xC2\xB0/s");
  CHECK(message.signals[2].multiplexed);
  CHECK(database->messages[1].name == "Empty");
  CHECK(database->find("Lost") == nullptr);
  CHECK(database->find("Ext", "Lost") == nullptr);
}

TEST_CASE("errors name file, line and token", "[dbc]") {
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n SG_ s : 7|x@0- (1,0) [0|0] \"\" X\n"),
             Contains("t.dbc:2") && Contains("'x'"));
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n\n SG_ s : 7|65@0- (1,0) [0|0] \"\" X\n"),
             Contains("t.dbc:3") && Contains("'65'"));
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n SG_ s : 7|8@2- (1,0) [0|0] \"\" X\n"), Contains("'2-'"));
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n SG_ s : 7|8@0- (nan,0) [0|0] \"\" X\n"), Contains("the factor"));
  CHECK_THAT(dbc_error("BO_ one M: 8 X\n"), Contains("t.dbc:1") && Contains("'one'"));
  CHECK_THAT(dbc_error("BO_ 1 M 8 X\n"), Contains("expected ':'"));
  CHECK_THAT(dbc_error("\nSG_ s : 7|8@0- (1,0) [0|0] \"\" X\n"),
             Contains("t.dbc:2") && Contains("before any message"));
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\nCM_ \"never closed\n\n"),
             Contains("t.dbc:2") && Contains("never closed"));
  CHECK_THAT(dbc_error("BO_ 1"), Contains("the end of the file"));
  CHECK_THAT(dbc_error("hello"), Contains("no message"));
  CHECK_THAT(load_dbc("/nonexistent.dbc").error().message,
             Contains("/nonexistent.dbc") && Contains("No such file"));
}

TEST_CASE("a bad token costs its signal or message; the rest of the file is used", "[dbc]") {
  const auto parsed = [](const std::string& text) {
    const auto database = parse_dbc(text, "t.dbc");
    INFO((database.ok() ? "" : database.error().message));
    REQUIRE(database.ok());
    return *database;
  };
  const std::string good = " SG_ good : 0|8@1+ (1,0) [0|0] \"\" X\n";
  const std::string after = " SG_ after : 8|8@1+ (1,0) [0|0] \"\" X\n";
  const std::vector<std::pair<std::string, std::string>> bad_signals{
      {" SG_ bad : 7|x@0- (1,0) [0|0] \"\" X\n", "found 'x'; the signal is skipped"},
      {" SG_ bad : 7|8@0- (1,0 [0|0] \"\" X\n", "found '['; the signal is skipped"},
      {" SG_ bad : 7|8\n", "found 'SG_'; the signal is skipped"},
      {" SG_ bad m : 7|8@0- (1,0) [0|0] \"\" X\n", "found 'm'; the signal is skipped"},
      {" SG_ bad : 7|8@0- (1,0) [0|0] \"rad/s X\n", "the unit in quotes on one line"},
      {" SG_ bad : 7|8@0- (1,0) [0|0] rad/s X\n", "found 'rad/s'; the signal is skipped"}};
  for (const auto& [line, warning] : bad_signals) {
    CAPTURE(line);
    const DbcDatabase database = parsed("BO_ 1 M: 8 X\n" + good + line + after + "BO_ 2 N: 8 X\n" + good);
    REQUIRE(database.messages.size() == 2);
    CHECK(database.find("M", "good") != nullptr);
    CHECK(database.find("M", "bad") == nullptr);
    CHECK(database.find("M", "after") != nullptr);
    CHECK(database.find("N", "good") != nullptr);
    REQUIRE(database.warnings.size() == 1);
    CHECK_THAT(database.warnings.front(), Contains("t.dbc:") && Contains(warning));
  }
  const DbcDatabase message =
      parsed("BO_ 1 M: 8 X\n" + good + "BO_ two N: 8 X\n" + good + "BO_ 3 L: 8 X\n" + good);
  CHECK(message.find("M") != nullptr);
  CHECK(message.find("N") == nullptr);
  CHECK(message.find("L", "good") != nullptr);
  CHECK(message.find("M")->signals.size() == 1);
  REQUIRE(message.warnings.size() == 1);
  CHECK_THAT(message.warnings.front(),
             Contains("t.dbc:3: expected the message's identifier, found 'two'; the "
                      "message and its signals are skipped"));
  // A comment that is never closed takes its line only.
  const DbcDatabase comment = parsed("BO_ 1 M: 8 X\n" + good + "CM_ \"never closed;\nBO_ 2 N: 8 X\n");
  CHECK(comment.find("M", "good") != nullptr);
  CHECK(comment.find("N") != nullptr);
  CHECK_THAT(comment.warnings.at(0), Contains("t.dbc:3: this string is never closed; the statement"));
  // Many warnings are bounded.
  std::string many = "BO_ 1 M: 8 X\n" + good;
  for (int i = 0; i < 500; ++i) many += " SG_ bad" + std::to_string(i) + " : x\n";
  CHECK(parsed(many).warnings.size() == 65);
  CHECK_THAT(parsed(many).warnings.back(), Contains("436 further"));
  // Without anything usable the first problem is the error.
  CHECK_THAT(dbc_error("BO_ one M: 8 X\n" + good), Contains("t.dbc:1") && Contains("'one'"));
}

TEST_CASE("one bad token in a real DBC file costs one signal", "[dbc]") {
  std::string text = nilio::tests::read_file(nilio::tests::source_folder() + "/config/dbc/xsens_mti.dbc");
  const auto whole = parse_dbc(text, "xsens.dbc");
  REQUIRE(whole.ok());
  CHECK(whole->warnings.empty());
  const std::size_t factor = text.find('(', text.find(" SG_ ")) + 1;
  text.replace(factor, 1, "O");
  const auto damaged = parse_dbc(text, "xsens.dbc");
  REQUIRE(damaged.ok());
  CHECK(damaged->warnings.size() == 1);
  std::size_t signals_before = 0;
  std::size_t signals_after = 0;
  for (const DbcMessage& m : whole->messages) signals_before += m.signals.size();
  for (const DbcMessage& m : damaged->messages) signals_after += m.signals.size();
  CHECK(damaged->messages.size() == whole->messages.size());
  CHECK(signals_after == signals_before - 1);
}

TEST_CASE("every truncation of a DBC file is read or rejected", "[dbc]") {
  const std::string text =
      nilio::tests::read_file(nilio::tests::source_folder() + "/config/dbc/xsens_mti.dbc");
  REQUIRE(text.size() > 1000);
  std::size_t refused = 0;
  for (std::size_t length = 0; length < text.size(); ++length) {
    if (!parse_dbc(text.substr(0, length), "cut.dbc").ok()) ++refused;
  }
  CHECK(refused > 0);
  CHECK(parse_dbc(text, "whole.dbc").ok());
}

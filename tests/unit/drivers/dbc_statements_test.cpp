#include "nilio/drivers/can/dbc/dbc.hpp"

#include "tests/support/imu_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::dbc_error;

namespace {

using Bytes = std::vector<std::uint8_t>;

DbcDatabase parsed(const std::string& text) {
  const auto database = parse_dbc(text, "t.dbc");
  INFO((database.ok() ? "" : database.error().message));
  REQUIRE(database.ok());
  return *database;
}

std::optional<double> value(const DbcDatabase& database, const char* signal, const Bytes& payload) {
  const DbcMessage& message = database.messages.at(0);
  const DbcSignal* found = database.find(message.name, signal);
  REQUIRE(found != nullptr);
  return decode_physical(message, *found, payload);
}

std::string joined(const std::vector<std::string>& notes) {
  std::string text;
  for (const std::string& note : notes) text += note + "\n";
  return text;
}

std::string signal(const std::string& name_and_mark, const std::string& layout) {
  return " SG_ " + name_and_mark + " : " + layout + " (1,0) [0|0] \"\" X\n";
}

}  // namespace

TEST_CASE("a multiplexed signal has a value only in the frames that select it", "[dbc_statements]") {
  const DbcDatabase database = parsed("BO_ 1 M: 8 X\n" + signal("a m0", "8|8@1+") + signal("b m1", "8|8@1+") +
                                      signal("always", "16|8@1+") + signal("mode M", "0|8@1+"));
  CHECK(value(database, "a", {0, 7, 9}) == 7.0);
  CHECK_FALSE(value(database, "b", {0, 7, 9}).has_value());
  CHECK_FALSE(value(database, "a", {1, 7, 9}).has_value());
  CHECK(value(database, "b", {1, 7, 9}) == 7.0);
  for (const std::uint8_t mode : Bytes{0, 1, 2, 255}) {
    CHECK(value(database, "always", {mode, 7, 9}) == 9.0);
    CHECK(value(database, "mode", {mode, 7, 9}) == mode);
  }
  CHECK_FALSE(value(database, "a", {}).has_value());
  const DbcSignal* mode = database.find("M", "mode");
  CHECK(mode->multiplexer);
  CHECK_FALSE(mode->multiplexed);
}

TEST_CASE("extended multiplexing selects by ranges of a multiplexer, which may itself be selected",
          "[dbc_statements]") {
  const std::string text = "BO_ 1 M: 8 X\n" + signal("root M", "0|8@1+") + signal("sub m2M", "8|8@1+") +
                           signal("leaf m0", "16|8@1+") + signal("other m2", "24|8@1+") +
                           "SG_MUL_VAL_ 1 leaf sub 3-5, 9-9;\nSG_MUL_VAL_ 1 sub root 2-2;\n";
  const DbcDatabase database = parsed(text);
  const DbcSignal* sub = database.find("M", "sub");
  CHECK(sub->multiplexer);
  CHECK(sub->multiplexed);
  for (int byte = 0; byte < 12; ++byte) {
    const auto selector = static_cast<std::uint8_t>(byte);
    const bool selected = (byte >= 3 && byte <= 5) || byte == 9;
    CHECK(value(database, "leaf", {2, selector, 42, 43}).has_value() == selected);
    CHECK_FALSE(value(database, "leaf", {1, selector, 42, 43}).has_value());
    CHECK(value(database, "other", {2, selector, 42, 43}) == 43.0);
  }
}

TEST_CASE("invalid multiplexing is named with its place in the file, and no frame has the signal",
          "[dbc_statements]") {
  const std::string message = "BO_ 1 M: 8 X\n" + signal("root M", "0|8@1+") + signal("a m0M", "8|8@1+");
  const auto warning = [&](const std::string& statement) {
    const DbcDatabase database = parsed(message + statement);
    CHECK(value(database, "root", {0, 7}).has_value() == (statement.find(" root a") == std::string::npos));
    CHECK_FALSE(value(database, "a", {0, 7}).has_value());
    return joined(database.warnings);
  };
  CHECK_THAT(warning("SG_MUL_VAL_ 1 a a 0-0;\n"), Contains("'a'") && Contains("select each other"));
  CHECK_THAT(warning("SG_MUL_VAL_ 1 a root 0-0;\nSG_MUL_VAL_ 1 root a 0-0;\n"),
             Contains("select each other"));
  CHECK_THAT(warning("SG_MUL_VAL_ 1 a nobody 0-0;\n"), Contains("t.dbc:4") && Contains("'nobody'"));
  CHECK_THAT(warning("SG_MUL_VAL_ 1 a root 5-3;\n"), Contains("'5-3'") && Contains("range"));
  // Without its message the statement is nobody's, and the mark m0 counts.
  for (const char* statement :
       {"SG_MUL_VAL_ 2 a root 0-0;\n", "SG_MUL_VAL_ 1 a root;\n", "SG_MUL_VAL_ x;\n"}) {
    const DbcDatabase database = parsed(message + statement);
    CHECK(value(database, "a", {0, 7}) == 7.0);
    REQUIRE(database.warnings.size() == 1);
    CHECK_THAT(database.warnings.front(), Contains("t.dbc:4") && Contains("statement is skipped"));
  }
  for (const char* mark : {"m", "mM", "x3", "m3x", "MM"}) {
    CAPTURE(mark);
    CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n" + signal(std::string("a ") + mark, "0|8@1+")),
               Contains("t.dbc:2") && Contains("multiplexing mark") && Contains(mark));
  }
  const DbcDatabase rootless = parsed("BO_ 1 M: 8 X\n" + signal("a m0", "0|8@1+"));
  CHECK_FALSE(value(rootless, "a", {0}).has_value());
  CHECK_THAT(joined(rootless.notes), Contains("'a'") && Contains("no multiplexer"));
}

TEST_CASE("CAN FD frames hold signals beyond the eighth byte", "[dbc_statements]") {
  const DbcDatabase database =
      parsed("BO_ 1 M: 64 X\n" + signal("late", "496|16@1+") + signal("motorola", "71|16@0-") +
             "BA_DEF_ BO_ \"VFrameFormat\" ENUM \"StandardCAN\",\"ExtendedCAN\";\n");
  Bytes payload(64);
  payload[62] = 0x34;
  payload[63] = 0x12;
  payload[8] = 0xFF;
  payload[9] = 0xFE;
  CHECK(value(database, "late", payload) == 0x1234);
  CHECK(value(database, "motorola", payload) == -2.0);
  payload.pop_back();
  CHECK_FALSE(value(database, "late", payload).has_value());
}

TEST_CASE("frame format and cycle time come from the attributes or their defaults", "[dbc_statements]") {
  const DbcDatabase database = parsed(
      "BO_ 1 A: 8 X\nBO_ 2 B: 64 X\nBO_ 2566844926 C: 8 X\nBO_ 4 D: 8 X\n"
      "BA_DEF_ BO_ \"VFrameFormat\" ENUM "
      "\"StandardCAN\",\"ExtendedCAN\",\"reserved\",\"J1939PG\",\"reserved\","
      "\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\",\"reserved\","
      "\"reserved\","
      "\"reserved\",\"StandardCAN_FD\",\"ExtendedCAN_FD\";\n"
      "BA_DEF_ BO_ \"GenMsgCycleTime\" INT 0 65535;\nBA_DEF_ \"BusType\" STRING ;\n"
      "BA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";\nBA_DEF_DEF_ \"GenMsgCycleTime\" 20;\n"
      "BA_ \"BusType\" \"CAN FD\";\nBA_ \"VFrameFormat\" BO_ 2 14;\nBA_ \"VFrameFormat\" BO_ 2566844926 3;\n"
      "BA_ \"VFrameFormat\" BO_ 4 3;\nBA_ \"GenMsgCycleTime\" BO_ 1 2.5;\nBA_ \"GenMsgCycleTime\" BO_ 99 1;\n"
      "BA_ \"VFrameFormat\" BO_ 1 99;\n");
  CHECK_FALSE(database.messages[0].flexible_data_rate);
  CHECK(database.messages[0].cycle_ms == 2.5);
  CHECK(database.messages[1].flexible_data_rate);
  CHECK(database.messages[1].cycle_ms == 20.0);
  CHECK(database.messages[2].j1939);
  // An identifier of 11 bits has no parameter group.
  CHECK_FALSE(database.messages[3].j1939);
}

TEST_CASE("value tables and comments are kept with their signals, in UTF-8", "[dbc_statements]") {
  const DbcDatabase database =
      parsed("VAL_TABLE_ onoff 1 \"on\" 0 \"off\" ;\r\nBO_ 1 M: 8 X\r\n" + signal("a", "0|8@1-") +
             signal("b", "8|8@1+") +
             "CM_ \"of the file\";\r\nCM_ BU_ X \"of a node\";\r\nCM_ BO_ 1 \"of the\r\nmessage; BO_ 2\";\r\n"
             "CM_ SG_ 1 a \"in \xB5m/s\xB2\";\r\nCM_ SG_ 1 b \"in m/s\xC2\xB2\";\r\n"
             "VAL_ 1 a -1 \"unknown\" 0 \"0 \xB0\" ;\r\nVAL_ 1 b onoff ;\r\nVAL_ variable 0 \"x\" ;\r\n");
  const DbcMessage& message = database.messages.at(0);
  CHECK(message.comment == "of the\r\nmessage; BO_ 2");
  CHECK(message.signals[0].comment == "in \xC2\xB5m/s\xC2\xB2");
  CHECK(message.signals[1].comment == "in m/s\xC2\xB2");
  REQUIRE(message.signals[0].values.size() == 2);
  CHECK(message.signals[0].values[0].raw == -1);
  CHECK(message.signals[0].values[0].name == "unknown");
  CHECK(message.signals[0].values[1].name == "0 \xC2\xB0");
  REQUIRE(message.signals[1].values.size() == 2);
  CHECK(message.signals[1].values[0].name == "on");
  CHECK_THAT(joined(database.notes), Contains("environment variable"));
}

TEST_CASE("unused and contradictory statements are named in the notes", "[dbc_statements]") {
  const DbcDatabase database = parsed(
      "BO_ 1 M: 8 X\n" + signal("a", "60|8@1+") + signal("b", "0|8@1+") + signal("b", "8|8@1+") +
      "BO_ 1 Again: 8 X\nBO_ 2048 Wide: 8 X\nBO_ 5 Long: 1785 X\nSIG_GROUP_ 1 g 1 : a;\nSIG_GROUP_ 1 h 1 : "
      "b;\n"
      "EV_ v: 0 [0|1] \"\" 0 1 DUMMY_NODE_VECTOR0 X;\nVAL_ 1 b 0 1 2;\nVAL_ 7 b 0 \"x\";\nCM_ SG_ 1 b;\n"
      "SIG_VALTYPE_ 9 b : 1;\n");
  const std::string notes = joined(database.notes);
  for (const char* part :
       {"'a' of message 'M' does not fit into its 8 bytes", "two signals 'b'",
        "line 5: message 'Again' has the identifier of a message above", "2048", "1785 bytes",
        "line 8: 'SIG_GROUP_' is not used (2 times)", "'EV_'", "VAL_", "CM_", "SIG_VALTYPE_"}) {
    CAPTURE(part);
    CHECK_THAT(notes, Contains(part));
  }
  std::string many = "BO_ 1 M: 8 X\n";
  for (int i = 0; i < 500; ++i) many += "KEYWORD" + std::to_string(i) + "_ x;\n";
  const DbcDatabase flooded = parsed(many);
  CHECK(flooded.notes.size() < 100);
  CHECK_THAT(flooded.notes.back(), Contains("further"));
}

TEST_CASE("double and float signals are read in both byte orders", "[dbc_statements]") {
  const DbcDatabase database =
      parsed("BO_ 1 M: 24 X\n" + signal("little", "0|64@1-") + signal("big", "71|64@0-") +
             signal("single", "128|32@1-") +
             "SIG_VALTYPE_ 1 little : 2;\nSIG_VALTYPE_ 1 big : 2;\nSIG_VALTYPE_ 1 single 1;\n");
  Bytes payload{0, 0, 0, 0, 0, 0, 0xF8, 0x3F, 0xC0, 0x04, 0, 0, 0, 0, 0, 0, 0, 0, 0x80, 0xBF};
  CHECK(value(database, "little", payload) == 1.5);
  CHECK(value(database, "big", payload) == -2.5);
  CHECK(value(database, "single", payload) == -1.0);
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n" + signal("a", "0|16@1-") + "SIG_VALTYPE_ 1 a : 1;\n"),
             Contains("t.dbc:3") && Contains("32 or 64 bits"));
  CHECK_THAT(dbc_error("BO_ 1 M: 8 X\n" + signal("a", "0|32@1-") + "SIG_VALTYPE_ 1 a : 3;\n"),
             Contains("'3'") && Contains("value type"));
  // Beside usable signals, one of unknown type is removed; as an integer its values would be wrong.
  const DbcDatabase half =
      parsed("BO_ 1 M: 8 X\n" + signal("root M", "0|8@1+") + signal("a", "8|32@1-") +
             signal("b m3", "40|8@1+") + signal("sub m0M", "48|8@1+") + signal("leaf m1", "56|8@1+") +
             "SG_MUL_VAL_ 1 leaf sub 1-1;\nSIG_VALTYPE_ 1 a : x;\n");
  CHECK(half.find("M", "a") == nullptr);
  CHECK_THAT(joined(half.warnings), Contains("t.dbc:8") && Contains("'x'"));
  CHECK(value(half, "b", {3, 0, 0, 0, 0, 9, 0, 0}) == 9.0);
  CHECK(value(half, "leaf", {0, 0, 0, 0, 0, 0, 1, 5}) == 5.0);
  CHECK_FALSE(value(half, "leaf", {0, 0, 0, 0, 0, 0, 2, 5}).has_value());
}

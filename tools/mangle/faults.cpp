#include "tools/mangle/faults.hpp"

#include <charconv>
#include <cmath>
#include <sstream>
#include <string_view>

namespace nilio::tools::mangle {

namespace {

using core::Error;
using core::Result;

constexpr double kMaxSeconds = 1e6;

std::optional<double> parse_number(std::string_view text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

/// The numbers on either side of `separator`.
std::optional<std::pair<double, double>> parse_pair(const std::string& text, char separator) {
  const std::size_t middle = text.find(separator);
  if (middle == std::string::npos) return std::nullopt;
  const auto first = parse_number(std::string_view(text).substr(0, middle));
  const auto second = parse_number(std::string_view(text).substr(middle + 1));
  if (!first || !second) return std::nullopt;
  return std::pair(*first, *second);
}

bool is_share(double value) { return value >= 0.0 && value <= 1.0; }

Result<std::monostate> check_timed(const std::vector<TimedFault>& faults, const char* option,
                                   double min_amount_s) {
  for (const TimedFault& fault : faults) {
    const bool good = fault.amount_s >= min_amount_s && std::abs(fault.amount_s) <= kMaxSeconds &&
                      fault.amount_s != 0.0 && fault.at_s >= 0.0 && fault.at_s <= kMaxSeconds;
    if (!good)
      return Error{std::string(option) + ": needs SECONDS@TIME with a time of at least 0 and " +
                   (min_amount_s >= 0.0 ? "a length above 0" : "a step other than 0")};
  }
  return std::monostate{};
}

Result<std::monostate> check_values(const Faults& f) {
  if (!is_share(f.loss) || !is_share(f.duplicate) || !is_share(f.reorder) || !is_share(f.ghosts))
    return Error{"--loss, --duplicate, --reorder, --ghosts: need a share from 0 to 1"};
  if (!(f.thin > 0.0 && f.thin <= 1.0)) return Error{"--thin: needs the share that remains, above 0 up to 1"};
  if (!(f.noise_m >= 0.0 && f.noise_m <= 10.0)) return Error{"--noise: needs metres from 0 to 10"};
  if (!(f.field_of_view_deg > 0.0 && f.field_of_view_deg <= 360.0))
    return Error{"--fov: needs degrees above 0 up to 360"};
  if (f.burst && (f.burst->count == 0 || !(f.burst->period_s > 0.0)))
    return Error{"--burst: needs COUNT/SECONDS, both above 0"};
  if (auto checked = check_timed(f.gaps, "--gap", 0.0); !checked) return checked;
  return check_timed(f.clock_steps, "--clock-step", -kMaxSeconds);
}

void add_share(std::ostringstream& text, const char* option, double value, double unchanged) {
  if (value != unchanged) text << ' ' << option << ' ' << value;
}

}  // namespace

Result<TimedFault> parse_timed_fault(const std::string& text) {
  const auto pair = parse_pair(text, '@');
  if (!pair) return Error{"'" + text + "' is not SECONDS@TIME, such as 0.5@30"};
  return TimedFault{pair->first, pair->second};
}

Result<BurstLoss> parse_burst_loss(const std::string& text) {
  const auto pair = parse_pair(text, '/');
  const bool good = pair && pair->first >= 1.0 && pair->first <= 1e6 &&
                    pair->first == std::floor(pair->first) && pair->second > 0.0;
  if (!good) return Error{"'" + text + "' is not COUNT/SECONDS, such as 20/1.5"};
  return BurstLoss{static_cast<unsigned>(pair->first), pair->second};
}

Result<std::monostate> check_faults(const Faults& f) {
  if (!f.changes_packets() && !f.changes_scans() && !f.changes_returns())
    return Error{"no fault is given - nilio mangle --help lists them"};
  if (f.drop_scans == 1) return Error{"--drop-scans 1: would drop every scan - give 2 or more"};
  if (f.thin < 1.0 && f.points > 0)
    return Error{"--thin and --points: both choose the returns that remain - give one of them"};
  if (f.reverse && (f.changes_packets() || !f.gaps.empty()))
    return Error{"--reverse: times of other faults would count from the end - mangle twice"};
  return check_values(f);
}

std::string to_options(const Faults& f) {
  std::ostringstream text;
  for (const TimedFault& gap : f.gaps) text << " --gap " << gap.amount_s << '@' << gap.at_s;
  add_share(text, "--loss", f.loss, 0.0);
  if (f.burst) text << " --burst " << f.burst->count << '/' << f.burst->period_s;
  add_share(text, "--duplicate", f.duplicate, 0.0);
  add_share(text, "--reorder", f.reorder, 0.0);
  for (const TimedFault& step : f.clock_steps) text << " --clock-step " << step.amount_s << '@' << step.at_s;
  add_share(text, "--ghosts", f.ghosts, 0.0);
  add_share(text, "--thin", f.thin, 1.0);
  if (f.points > 0) text << " --points " << f.points;
  if (f.rings > 0) text << " --rings " << f.rings;
  if (f.drop_scans > 0) text << " --drop-scans " << f.drop_scans;
  add_share(text, "--noise", f.noise_m, 0.0);
  add_share(text, "--fov", f.field_of_view_deg, 360.0);
  if (f.vegetation_only) text << " --vegetation-only";
  if (f.reverse) text << " --reverse";
  if (f.seed != 1) text << " --seed " << f.seed;
  const std::string options = text.str();
  return options.empty() ? options : options.substr(1);
}

}  // namespace nilio::tools::mangle

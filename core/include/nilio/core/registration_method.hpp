#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace nilio::core {

/// How a scan is registered against the map: NI-LIO's NDT and ICP, and the methods that its paper compares
/// them with.
enum class RegistrationMethod : std::uint8_t { kNdtIcp, kNdt, kIcpPlane, kIcpLine, kIcpPoint };

/// All methods, the default first.
inline constexpr std::array kRegistrationMethods = {
    RegistrationMethod::kNdtIcp, RegistrationMethod::kNdt, RegistrationMethod::kIcpPlane,
    RegistrationMethod::kIcpLine, RegistrationMethod::kIcpPoint};

/// Name in configuration and tables: "ndt_icp", ...
const char* name_of(RegistrationMethod method);
/// The method of that name, or nothing.
std::optional<RegistrationMethod> registration_method_of(std::string_view name);

}  // namespace nilio::core

#pragma once

/// Elementary functions with the same bits on every processor. The C library picks variants with fused
/// multiply-add where the processor has them, and about one argument in 1500 then gives other bits: enough
/// for another trajectory after some kilometres. Everything between packets and poses uses these instead.
///
/// Errors are below 3.5 units in the last place (exp: 1.0). From the library SLEEF, its reproducible
/// functions.
namespace nilio::portable {

double sin(double radians);
double cos(double radians);
double tan(double radians);
double acos(double cosine);
double atan2(double y, double x);
double exp(double x);
double log(double x);

}  // namespace nilio::portable

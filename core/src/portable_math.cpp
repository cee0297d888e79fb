#include "nilio/core/portable_math.hpp"

#include <sleef.h>

namespace nilio::portable {

// "cinz": consistent bits without fused multiply-add.
double sin(double radians) { return Sleef_cinz_sind1_u35purec(radians); }
double cos(double radians) { return Sleef_cinz_cosd1_u35purec(radians); }
double tan(double radians) { return Sleef_cinz_tand1_u35purec(radians); }
double acos(double cosine) { return Sleef_cinz_acosd1_u35purec(cosine); }
double atan2(double y, double x) { return Sleef_cinz_atan2d1_u35purec(y, x); }
double exp(double x) { return Sleef_cinz_expd1_u10purec(x); }
double log(double x) { return Sleef_cinz_logd1_u35purec(x); }

}  // namespace nilio::portable

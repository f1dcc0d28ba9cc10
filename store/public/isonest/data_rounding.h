// Rounding of a volume's values before they were stored.
#pragma once

namespace isonest {

/// How the values of a store differ from those of the volume that it was made from.
struct DataRounding {
    double tolerance = 0;  ///< the largest change of a value; 0: none was changed
    double step = 0;       ///< what values were rounded to multiples of; 0: none was changed

    [[nodiscard]] bool none() const { return step == 0; }
    bool operator==(const DataRounding&) const = default;
};

}  // namespace isonest

#include "preprocess/sources/hdf5/exact_transfer.h"

#include <hdf5.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace isonest::detail {
namespace {

/// HDF5 takes all negative integers of 64 bits for too long for float64.
bool is_exact(hid_t from, const void* in, void* out) {
    constexpr std::size_t kSize = 8;
    if (H5Tget_class(from) != H5T_INTEGER || H5Tget_sign(from) != H5T_SGN_2 ||
        H5Tget_size(from) != kSize || H5Tget_precision(from) != 8 * kSize) {
        return false;
    }
    std::array<std::byte, kSize> bytes{};
    std::memcpy(bytes.data(), in, kSize);
    if (H5Tget_order(from) != H5Tget_order(H5T_NATIVE_INT64)) {
        std::reverse(bytes.begin(), bytes.end());
    }
    std::int64_t value = 0;
    std::memcpy(&value, bytes.data(), kSize);
    constexpr std::int64_t kMost = std::int64_t{1} << 53U;
    if (value < -kMost || value > kMost) {
        return false;
    }
    const auto converted = static_cast<double>(value);
    std::memcpy(out, &converted, kSize);
    return true;
}

H5T_conv_ret_t stop_if_lossy(H5T_conv_except_t kind, hid_t from, hid_t /*to*/, void* in, void* out,
                             void* lossy) {
    if (kind == H5T_CONV_EXCEPT_PRECISION && is_exact(from, in, out)) {
        return H5T_CONV_HANDLED;
    }
    if (kind != H5T_CONV_EXCEPT_PRECISION && kind != H5T_CONV_EXCEPT_RANGE_HI &&
        kind != H5T_CONV_EXCEPT_RANGE_LOW && kind != H5T_CONV_EXCEPT_TRUNCATE) {
        return H5T_CONV_UNHANDLED;
    }
    *static_cast<bool*>(lossy) = true;
    return H5T_CONV_ABORT;
}

}  // namespace

PropertyHandle exact_transfer(bool& lossy) {
    PropertyHandle transfer(H5Pcreate(H5P_DATASET_XFER));
    H5Pset_type_conv_cb(transfer.get(), &stop_if_lossy, &lossy);
    return transfer;
}

}  // namespace isonest::detail

#include "preprocess/sources/hdf5/far_contiguous.h"

#include <algorithm>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/numbers/far_numbers.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

std::unique_ptr<VolumeSource> open_far_contiguous(const InputFile& file, hid_t dataset,
                                                  const DatasetShape& shape,
                                                  const Hdf5Number& number,
                                                  const std::string& name) {
    const PropertyHandle creation(H5Dget_create_plist(dataset));
    const TypeHandle stored(H5Dget_type(dataset));
    const haddr_t offset = offset_of_values(dataset);
    const TypeHandle swapped(H5Tcopy(number.memory_type));
    H5Tset_order(swapped.get(), H5T_ORDER_BE);
    RawLayout layout;
    layout.big_endian = H5Tequal(stored.get(), swapped.get()) > 0;
    if (H5Pget_layout(creation.get()) != H5D_CONTIGUOUS || offset == HADDR_UNDEF ||
        (!layout.big_endian && H5Tequal(stored.get(), number.memory_type) <= 0)) {
        return nullptr;
    }
    std::vector<hsize_t> strides(shape.dims.size());
    hsize_t values = 1;
    const std::uint64_t size = file.bytes()->size();
    const auto require = [&](bool fits) {
        if (!fits) {
            throw Error(ErrorKind::corrupt, {name}, "the object ends before the dataset does");
        }
    };
    for (std::size_t i = shape.dims.size(); i-- > 0;) {
        require(values <= size / shape.dims[i]);
        strides[i] = values;
        layout.first += shape.at.empty() ? 0 : shape.at[i] * values;
        values *= shape.dims[i];
    }
    layout.nodes = shape.along_axes(shape.dims);
    layout.type = number.type;
    layout.offset = offset;
    require(values <= size / size_of(layout.type) &&
            lies_within(offset, values * size_of(layout.type), size));
    if (values != static_cast<hsize_t>(layout.nodes.product()) ||
        !std::is_sorted(shape.axes.begin(), shape.axes.end())) {
        layout.strides = shape.along_axes(strides);
        layout.whole = values;
    }
    return open_far_numbers(file, name, layout);
}

}  // namespace isonest::detail

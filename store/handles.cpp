#include "store/handles.h"

namespace isonest {

std::string hdf5_message() {
    std::string text;
    H5Ewalk2(
        H5E_DEFAULT, H5E_WALK_UPWARD,
        [](unsigned, const H5E_error2_t* error, void* data) -> herr_t {
            auto& out = *static_cast<std::string*>(data);
            if (out.empty() && error->desc != nullptr) {
                out = error->desc;
            }
            return 0;
        },
        &text);
    return text;
}

}  // namespace isonest

#include "tools/view/store_watch.h"

#include <isonest/error.h>

namespace isonest::detail::view {

StoreWatch::StoreWatch(const Store& store) {
    if (store.is_remote()) {
        return;
    }
    path_ = std::filesystem::absolute(store.path());
    if (::stat(path_.c_str(), &opened_) != 0) {
        throw Error(ErrorKind::not_found, {store.path().string()}, "no such file");
    }
}

StoreState StoreWatch::state() const {
    if (path_.empty()) {
        return StoreState::same;
    }
    struct stat now {};
    if (::stat(path_.c_str(), &now) != 0 || now.st_dev != opened_.st_dev ||
        now.st_ino != opened_.st_ino) {
        return StoreState::replaced;
    }
    if (now.st_size < opened_.st_size) {
        return StoreState::cut_off;
    }
    const bool written = now.st_size != opened_.st_size ||
                         now.st_mtim.tv_sec != opened_.st_mtim.tv_sec ||
                         now.st_mtim.tv_nsec != opened_.st_mtim.tv_nsec;
    return written ? StoreState::replaced : StoreState::same;
}

const char* name_of(StoreState state) {
    switch (state) {
        case StoreState::same:
            return "ok";
        case StoreState::replaced:
            return "replaced";
        case StoreState::cut_off:
            return "cut off";
    }
    return "";
}

}  // namespace isonest::detail::view

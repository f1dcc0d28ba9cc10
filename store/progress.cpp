#include "store/progress.h"

#include "store/error.h"

namespace isonest {

void Progress::check() const {
    if (cancelled()) {
        throw Error(ErrorKind::cancelled, "interrupted; nothing was left behind");
    }
}

Progress& silent_progress() {
    static Progress instance;
    return instance;
}

}  // namespace isonest

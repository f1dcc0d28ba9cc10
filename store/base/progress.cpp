#include <isonest/error.h>
#include <isonest/progress.h>

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

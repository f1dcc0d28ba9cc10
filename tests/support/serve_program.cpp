// Preloaded into the program, runs its main() again and again, each time in a forked process in
// which everything is loaded already: loading the program takes longer than most test runs.
// served.py is the other end, and says when not to use it.
//
//   LD_PRELOAD=libisonest_serve.so ISONEST_SERVE=SOCKET isonest
//
// A request is the number of its bytes, of its arguments, and the umask (uint32 each, native), with
// three file descriptors: standard input, output and error. It is followed by the arguments, the
// working folder and the environment, each ended by a zero byte. Two int32 answer it: the process's
// id, and its status as waitpid() gives it. The end of the socket ends the program.
#include <dlfcn.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

namespace {

using Main = int (*)(int, char**, char**);
Main program_main = nullptr;
const char* socket_number = nullptr;

struct Request {
    std::array<int, 3> files;
    std::string text;
    std::uint32_t arguments = 0;
    mode_t mask = 0;
};

void receive_all(int socket, void* to, std::size_t count) {
    auto* at = static_cast<char*>(to);
    while (count > 0) {
        const ssize_t got = ::recv(socket, at, count, 0);
        if (got <= 0) {
            ::_exit(got == 0 ? 0 : 1);
        }
        at += got;
        count -= static_cast<std::size_t>(got);
    }
}

Request receive(int socket) {
    Request request;
    std::array<std::uint32_t, 3> counts{};
    alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof request.files)> control{};
    iovec where{counts.data(), sizeof counts};
    msghdr message{};
    message.msg_iov = &where;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    if (::recvmsg(socket, &message, MSG_WAITALL) != static_cast<ssize_t>(sizeof counts)) {
        ::_exit(0);
    }
    const cmsghdr* const header = CMSG_FIRSTHDR(&message);
    if (header == nullptr || header->cmsg_len != CMSG_LEN(sizeof request.files)) {
        ::_exit(1);
    }
    std::memcpy(request.files.data(), CMSG_DATA(header), sizeof request.files);
    request.text.resize(counts[0]);
    request.arguments = counts[1];
    request.mask = counts[2];
    receive_all(socket, request.text.data(), request.text.size());
    return request;
}

[[noreturn]] void run(const Request& request) {
    for (int i = 0; i < 3; ++i) {
        ::dup2(request.files[static_cast<std::size_t>(i)], i);
        ::close(request.files[static_cast<std::size_t>(i)]);
    }
    // Kept until the process ends: arguments and environment point into it.
    static std::string text = request.text;
    std::vector<char*> words;
    for (std::size_t at = 0; at < text.size(); at += std::strlen(text.data() + at) + 1) {
        words.push_back(text.data() + at);
    }
    const auto count = static_cast<std::ptrdiff_t>(request.arguments);
    std::vector<char*> arguments(words.begin(), words.begin() + count);
    arguments.push_back(nullptr);
    if (::chdir(words[request.arguments]) != 0) {
        ::_exit(127);
    }
    ::umask(request.mask);
    ::clearenv();
    for (std::size_t i = request.arguments + 1; i < words.size(); ++i) {
        ::putenv(words[i]);
    }
    const int code = program_main(static_cast<int>(count), arguments.data(), environ);
    std::fflush(nullptr);
    std::quick_exit(code);  // destructors of loaded libraries would take longer than the rest
}

int serve(int /*argc*/, char** /*argv*/, char** /*environment*/) {
    const int socket = std::atoi(socket_number);
    for (;;) {
        const Request request = receive(socket);
        const pid_t server = ::getpid();
        const pid_t child = ::fork();
        if (child == 0) {
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);
            if (::getppid() != server) {
                ::_exit(1);
            }
            ::close(socket);
            run(request);
        }
        for (const int file : request.files) {
            ::close(file);
        }
        std::array<std::int32_t, 2> answer{child, -1};
        ::send(socket, answer.data(), sizeof answer[0], MSG_NOSIGNAL);
        while (child > 0 && ::waitpid(child, &answer[1], 0) < 0 && errno == EINTR) {
        }
        ::send(socket, &answer[1], sizeof answer[1], MSG_NOSIGNAL);
    }
}

}  // namespace

// glibc's, which starts main().
// NOLINTBEGIN(bugprone-reserved-identifier,readability-identifier-naming)
extern "C" int __libc_start_main(Main main, int argc, char** argv, void (*init)(), void (*fini)(),
                                 void (*loader_fini)(), void* stack_end) {
    program_main = main;
    socket_number = std::getenv("ISONEST_SERVE");
    const auto start =
        reinterpret_cast<decltype(&__libc_start_main)>(::dlsym(RTLD_NEXT, "__libc_start_main"));
    return start(socket_number != nullptr ? serve : main, argc, argv, init, fini, loader_fini,
                 stack_end);
}
// NOLINTEND(bugprone-reserved-identifier,readability-identifier-naming)

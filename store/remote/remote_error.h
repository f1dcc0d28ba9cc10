// What is said of requests that failed for good. Nothing that a server or a URL could hide in them
// is said: no query, no header, no body.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "store/remote/answer.h"

namespace isonest::detail {

/// A request that ended without what was asked for.
struct Failure {
    FailureClass failure = FailureClass::final;
    std::string problem;
    ErrorKind kind = ErrorKind::io;
    std::vector<Remedy> remedies = {};
    std::optional<std::chrono::seconds> retry_after = std::nullopt;
    bool is_change = false;  ///< the object is another one now
    bool is_void = false;    ///< what came of this answer may be no bytes of the object
    int status = 0;          ///< of the answer; 0: there was none
};

/// Of an answer with such a status, for the problem that judge() found. `code`: of S3's message,
/// may be empty. `is_signed`: by S3's keys.
Failure failure_of_answer(const AnswerHead& head, const Judgement& judgement,
                          const std::string& code, bool is_signed);
/// Of a transfer that libcurl gave up. `code`: its CURLcode; `text`: what libcurl says about it.
Failure failure_of_transfer(int code, const std::string& text);
Failure failure_of_change();
/// `tries`: requests that failed in a row.
Error error_of(const Failure& failure, const std::string& name, int tries);

/// "AccessDenied" of S3's <Error><Code>AccessDenied</Code>...; empty if it is not of that form.
std::string s3_code_in(std::string_view body);

}  // namespace isonest::detail

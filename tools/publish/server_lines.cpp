#include "tools/publish/check_server.h"

namespace isonest::detail::publish {
namespace {

/// Whether something is missing by which pages of other servers may read the store.
bool lacks_sharing(const ServerCheck& check) {
    return check.has(ServerFault::origin) || check.has(ServerFault::exposed) ||
           check.has(ServerFault::preflight);
}

ServerLines nginx_lines(const ServerCheck& check) {
    const bool shares = lacks_sharing(check);
    std::string text;
    if (shares || check.has(ServerFault::encoding)) {
        text += "location ~ \\.isonest$ {\n";
        if (check.has(ServerFault::encoding)) {
            text += "    gzip off;\n";
        }
        if (shares) {
            text +=
                "    add_header Access-Control-Allow-Origin \"*\" always;\n"
                "    add_header Access-Control-Expose-Headers \"ETag\" always;\n"
                "    if ($request_method = OPTIONS) {\n"
                "        add_header Access-Control-Allow-Origin \"*\";\n"
                "        add_header Access-Control-Allow-Headers \"Range\";\n"
                "        add_header Access-Control-Max-Age 86400;\n"
                "        return 204;\n"
                "    }\n";
        }
        text += "}\n";
    }
    if (check.has(ServerFault::ranges)) {
        text +=
            "max_ranges 1;             # 0 switches ranges off\n"
            "proxy_force_ranges on;    # where it passes on what another server sends\n";
    }
    if (check.has(ServerFault::etag)) {
        text += "etag on;\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "location ~ \\.wasm$ { types { application/wasm wasm; } }\n";
    }
    if (check.has(ServerFault::script_type)) {
        text += "location ~ \\.m?js$ { types { text/javascript js mjs; } }\n";
    }
    if (check.has(ServerFault::compression)) {
        text += "gzip on;\ngzip_types application/wasm text/javascript;\n";
    }
    return {"nginx", "in the server block; nginx -s reload takes them", text};
}

ServerLines apache_lines(const ServerCheck& check) {
    const bool shares = lacks_sharing(check);
    std::string text;
    if (shares || check.has(ServerFault::encoding)) {
        text += "<FilesMatch \"\\.isonest$\">\n";
        if (check.has(ServerFault::encoding)) {
            text += "    SetEnv no-gzip 1\n";
        }
        if (shares) {
            text +=
                "    Header always set Access-Control-Allow-Origin \"*\"\n"
                "    Header always set Access-Control-Expose-Headers \"ETag\"\n"
                "    Header always set Access-Control-Allow-Headers \"Range\"\n"
                "    Header always set Access-Control-Max-Age \"86400\"\n";
        }
        text += "</FilesMatch>\n";
    }
    if (check.has(ServerFault::ranges)) {
        text += "MaxRanges default    # in the server's own configuration\n";
    }
    if (check.has(ServerFault::etag)) {
        text += "FileETag MTime Size\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "AddType application/wasm .wasm\n";
    }
    if (check.has(ServerFault::script_type)) {
        text += "AddType text/javascript .js .mjs\n";
    }
    if (check.has(ServerFault::compression)) {
        text += "AddOutputFilterByType DEFLATE application/wasm text/javascript\n";
    }
    return {"Apache",
            "in .htaccess of the folder, with the modules headers, env and deflate (a2enmod)",
            text};
}

ServerLines s3_lines(const ServerCheck& check) {
    std::string text;
    if (lacks_sharing(check)) {
        text +=
            "aws s3api put-bucket-cors --bucket BUCKET --cors-configuration '{\"CORSRules\": "
            "[{\"AllowedOrigins\": [\"*\"], \"AllowedMethods\": [\"GET\", \"HEAD\"], "
            "\"AllowedHeaders\": [\"Range\"], \"ExposeHeaders\": [\"ETag\"], \"MaxAgeSeconds\": "
            "86400}]}'\n";
    }
    if (check.has(ServerFault::encoding)) {
        text += "aws s3 cp STORE s3://BUCKET/STORE    # without --content-encoding\n";
    }
    if (check.has(ServerFault::wasm_type)) {
        text += "aws s3 cp isonest.wasm s3://BUCKET/isonest.wasm --content-type application/wasm\n";
    }
    if (check.has(ServerFault::script_type)) {
        text +=
            "aws s3 cp . s3://BUCKET/ --recursive --exclude '*' --include '*.js' --include '*.mjs' "
            "--content-type text/javascript\n";
    }
    if (check.has(ServerFault::compression)) {
        text +=
            "gzip -k isonest.wasm && aws s3 cp isonest.wasm.gz s3://BUCKET/isonest.wasm "
            "--content-type application/wasm --content-encoding gzip\n";
    }
    return {"S3", "once, with the bucket's name; S3 itself answers ranges and has ETags", text};
}

}  // namespace

std::vector<ServerLines> lines_to_add(const ServerCheck& check) {
    std::vector<ServerLines> all;
    for (ServerLines& lines :
         std::vector{nginx_lines(check), apache_lines(check), s3_lines(check)}) {
        if (!lines.lines.empty()) {
            all.push_back(std::move(lines));
        }
    }
    return all;
}

}  // namespace isonest::detail::publish

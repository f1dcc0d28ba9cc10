"""How the URL of an object is written, with a secret somewhere, and who may get to know it."""
import base64
import json


class Access:
    """How the URL of an object is written, with a secret somewhere."""

    def __init__(self, one, server):
        self.one, self.server = one, server
        secret = f"s3cret{one.seed}x"
        self.secrets, self.options, self.environment, self.is_signed = [secret], [], {}, False
        self.how = one.pick("user", "query", "header", "file", "netrc", "s3", "none")
        self.query, self.userinfo = "", ""
        if self.how == "user":
            self.userinfo = f"me:{secret}@"
            self.secrets.append(base64.b64encode(f"me:{secret}".encode()).decode())
        elif self.how == "query":
            self.query = f"?X-Amz-Signature={secret}&token={secret}"
        elif self.how == "header":
            self.options = ["--header", f"Authorization: Bearer {secret}", "--header", f"X-Key: {secret}"]
        elif self.how == "file":
            (one.folder / "headers").write_text(f"Authorization: Bearer {secret}\nX-Key: {secret}\n")
            self.options = ["--header", "@headers"]
        elif self.how == "netrc":
            (one.folder / "home").mkdir(exist_ok=True)
            (one.folder / "home" / ".netrc").write_text(f"machine 127.0.0.1 login me password {secret}\n")
            self.secrets.append(base64.b64encode(f"me:{secret}".encode()).decode())
        elif self.how == "s3":
            self.is_signed = True
            self.environment = {"AWS_ACCESS_KEY_ID": "KEYID", "AWS_SECRET_ACCESS_KEY": secret, "AWS_REGION": "us-east-1",
                                "AWS_SESSION_TOKEN": secret + "t", "AWS_ENDPOINT_URL": server.place("")}
        self.kept = [one.folder / "headers", one.folder / "home"]

    def url(self, name):
        if self.how == "s3":
            return f"s3://bucket/{name}"
        return self.server.url(name, self.userinfo) + self.query

    def fault_of_others(self):
        """What another server got that is not for it."""
        for request in self.server.other.seen:
            text = json.dumps({name: value for name, value in request.items() if name != "path"})
            if any(secret in text for secret in self.secrets) or "authorization" in request:
                return f"another server got a secret: {request}"
        for request in self.server.seen + self.server.other.seen:
            if "cookie" in request or "referer" in request:
                return f"a cookie, or where it comes from: {request}"
        return None

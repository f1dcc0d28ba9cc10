"""Certificates, passwords and signatures: used where they belong, and never shown.

usage: url_credentials_test.py ISONEST PLUGIN_FOLDER
"""
import json
import pathlib
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parents[1]))
from support.range_client import FOLDER, SIZE, Client  # noqa: E402
from support.range_server import RangeServer, certificate  # noqa: E402

TLS = certificate(FOLDER)


class Credentials(unittest.TestCase):
    def test_passwords_of_the_url_and_of_netrc(self):
        with RangeServer(FOLDER, password=("me", "pass word")) as server:
            with Client() as client:
                self.assertEqual(client.open(server.url("a.bin", "me:pass%20word@"))["size"], SIZE)
                self.assertEqual(client.read([0, 10])["errors"], [])
                self.assertIn("401", client.open(server.url("a.bin"))["error"]["message"])
                self.assertIn("401", client.open(server.url("a.bin", "me:wrong@"))["error"]["message"])
            home = FOLDER / "with_netrc"
            home.mkdir()
            (home / ".netrc").write_text('machine 127.0.0.1 login me password "pass word"\n', encoding="ascii")
            with Client(HOME=str(home)) as client:
                self.assertEqual(client.open(server.url("a.bin"))["size"], SIZE)

    def test_s3_is_signed(self):
        key = "some folder/a+b=ü%41~(1).bin"
        file = FOLDER / "bucket" / key
        file.parent.mkdir(parents=True)
        file.write_bytes((FOLDER / "a.bin").read_bytes())
        for session in ("", "a/session+token=="):
            with RangeServer(FOLDER, keys={"KEY": ("secret/+key", session)}) as server:
                names = {"AWS_ACCESS_KEY_ID": "KEY", "AWS_SECRET_ACCESS_KEY": "secret/+key", "AWS_REGION": "eu-x-1",
                         "AWS_SESSION_TOKEN": session, "AWS_ENDPOINT_URL": server.url("")}
                with Client(**names) as client:
                    answer = client.open(f"s3://bucket/{key}")
                    self.assertEqual(answer.get("name"), f"s3://bucket/{key}", (answer, server.notes))
                    self.assertEqual(client.read([0, 1000], [50_000, 1000], threads=2)["errors"], [])
                    self.assertIn("/eu-x-1/s3/", server.notes[0]["authorization"])
                    server.fault_of = lambda *_: "redirect:http://localhost:1/x"
                    self.assertIn("no credentials are sent", client.open(f"s3://bucket/{key}")["error"]["message"])
                    server.fault_of = lambda *_: None
                for wrong in ({"AWS_SECRET_ACCESS_KEY": "another"}, {"AWS_ACCESS_KEY_ID": "another"}):
                    with Client(**{**names, **wrong}) as client:
                        error = client.open(f"s3://bucket/{key}")["error"]
                        self.assertIn("403 Forbidden (SignatureDoesNotMatch)", error["message"])
                        self.assertIn("AWS_ACCESS_KEY_ID", error["remedies"][0]["text"])
                        self.assertNotIn("another", json.dumps(error))
        with RangeServer(FOLDER) as server, Client(AWS_ENDPOINT_URL=server.url("")) as client:
            self.assertEqual(client.open(f"s3://bucket/{key}")["size"], SIZE)
            self.assertNotIn("authorization", server.notes[0])

    def test_https_needs_a_trusted_certificate_and_stays_https(self):
        with RangeServer(FOLDER, tls=TLS) as server, RangeServer(FOLDER) as plain:
            with Client() as client:
                error = client.open(server.url("a.bin"))["error"]
                self.assertIn("certificate is not trusted", error["message"])
                self.assertEqual(error["remedies"][0]["value"], "SSL_CERT_FILE=CERTIFICATES.pem")
            with Client(CURL_CA_BUNDLE=str(FOLDER / "none.pem"), SSL_CERT_FILE=str(TLS[0])) as client:
                error = client.open(server.url("a.bin"))["error"]
                self.assertEqual(error["remedies"][0]["value"], "CURL_CA_BUNDLE=CERTIFICATES.pem")
            for name in ("SSL_CERT_FILE", "CURL_CA_BUNDLE"):
                with Client(**{name: str(TLS[0])}) as client:
                    self.assertEqual(client.open(server.url("a.bin"))["size"], SIZE)
                    self.assertEqual(client.read([0, 100_000], [500_000, 1000])["errors"], [])
            server.fault_of = lambda *_: f"redirect:{plain.url('a.bin')}"
            with Client(SSL_CERT_FILE=str(TLS[0])) as client:
                self.assertIn("from https to http", client.open(server.url("a.bin"))["error"]["message"])
            self.assertEqual(plain.requests, 0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)

"""Manifest and provenance: complete, canonical, times in one place only."""

from __future__ import annotations

import hashlib
import json

from assetbuild.report.bundle import BundleFile, manifest, media_type, provenance


def test_the_manifest_lists_digest_size_and_kind_of_every_file_in_order():
    files = [BundleFile.of_text("b/x.usda", "usd", "xyz"), BundleFile.of_text("a.md", "report", "")]
    content = json.loads(manifest("r", files).content)
    assert [row["path"] for row in content["files"]] == ["a.md", "b/x.usda"]
    assert content["files"][1]["sha256"] == hashlib.sha256(b"xyz").hexdigest()
    assert content["files"][1]["size"] == 3
    assert manifest("r", files).content == manifest("r", files[::-1]).content


def test_provenance_is_an_in_toto_statement_with_a_subject_for_each_file():
    files = [BundleFile.of_text("a", "x", "1"), BundleFile.of_text("b", "x", "2")]
    run = {"finishedOn": "2001-01-01T00:00:00+00:00"}
    statement = json.loads(provenance(files, "0" * 64, {}, [{"name": "n"}], run).content)
    assert statement["_type"] == "https://in-toto.io/Statement/v1"
    assert statement["predicateType"] == "https://slsa.dev/provenance/v1"
    assert {subject["name"] for subject in statement["subject"]} == {"a", "b"}
    assert statement["predicate"]["runDetails"]["metadata"] == run


def test_a_licence_text_is_plain_text():
    assert media_type("LICENSES/a.dist-info/licenses/LICENSE") == "text/plain"
    assert media_type("mjcf/go1.xml") == "application/xml"

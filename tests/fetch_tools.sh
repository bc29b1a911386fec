#!/bin/sh
# Fetches a browser and axe-core for the tests, where this machine allows it, and says what will be skipped.
# Usage: fetch_tools.sh FOLDER_OF_THE_ENVIRONMENT
AXE="axe-core@4.10.3"
SECONDS_ALLOWED=300
folder="$1/share/axe-core"

browser() {
    for name in chromium chromium-browser google-chrome google-chrome-stable; do
        command -v "$name" && return
    done
    return 1
}

if ! browser >/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing chromium for the tests of report pages"
    {
        timeout $SECONDS_ALLOWED apt-get update
        timeout $SECONDS_ALLOWED apt-get install --yes --no-install-recommends chromium
    } >/dev/null 2>&1
fi

if [ ! -f "$folder/package/axe.min.js" ] && command -v npm >/dev/null; then
    mkdir -p "$folder"
    (cd "$folder" && timeout $SECONDS_ALLOWED npm pack --silent "$AXE" && tar -xzf ./*.tgz package/axe.min.js && rm ./*.tgz) \
        >/dev/null 2>&1
fi

browser >/dev/null || echo "skipped: no chromium here and none could be installed; no page is looked at in a browser"
[ -f "$folder/package/axe.min.js" ] || echo "skipped: axe-core could not be fetched; accessibility is not judged"
[ -n "$RSGEN_DATA" ] || echo "skipped: RSGEN_DATA names no folder; no measured data are read"
exit 0

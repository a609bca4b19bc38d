#!/bin/sh
# Chromium for the tests of pages, where a package manager can be asked for it without a password.
# Never fails: without it those tests skip themselves and say so.
command -v chromium >/dev/null || command -v chromium-browser >/dev/null && exit 0
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
	echo "Installing Chromium for the tests of pages, once."
	{ apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
		--no-install-recommends chromium fonts-dejavu-core; } >/dev/null 2>&1 && exit 0
fi
echo "No Chromium: the tests of pages will be skipped. Install it to run them." >&2

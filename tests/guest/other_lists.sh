#!/bin/sh
# other_lists.sh DIR SUITE ARCHITECTURE [SCRIPT]: SCRIPT, kernel.sh if none is given, with package lists of its own: those of another suite, as Debian offers newer kernels for
# its stable release in one, or of another architecture.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$1.apt/lists/partial" "$1.apt/cache/archives/partial"
lists=$(cd "$1.apt" && pwd)
echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian $2 main" >"$lists/sources.list"
APT="-o APT::Architecture=$3 -o APT::Architectures=$3 -o Dir::Etc::sourcelist=$lists/sources.list -o Dir::Etc::sourceparts=- \
	-o Dir::State::lists=$lists/lists -o Dir::Cache=$lists/cache"
# A run without a network is content with what the last one fetched.
# shellcheck disable=SC2086
apt-get $APT update -qq || [ -f "$1/version" ]
export APT
"${4-$here/kernel.sh}" "$1"

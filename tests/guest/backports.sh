#!/bin/sh
# backports.sh DIR: kernel.sh for the newer kernel that Debian offers for its stable release, from package lists of its own.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$1.apt/lists/partial" "$1.apt/cache/archives/partial"
lists=$(cd "$1.apt" && pwd)
release=$(. /etc/os-release && echo "$VERSION_CODENAME")
echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian $release-backports main" >"$lists/sources.list"
APT="-o Dir::Etc::sourcelist=$lists/sources.list -o Dir::Etc::sourceparts=- -o Dir::State::lists=$lists/lists -o Dir::Cache=$lists/cache"
# A run without a network is content with what the last one fetched.
# shellcheck disable=SC2086
apt-get $APT update -qq || [ -f "$1/version" ]
export APT
"$here/kernel.sh" "$1"

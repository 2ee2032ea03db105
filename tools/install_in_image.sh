#!/usr/bin/env bash
# The steps of the Dockerfile, which also run without Docker in any fresh Debian 12 (such as a chroot).
# Usage: install_in_image.sh packages | build
set -eo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
here=$PWD state=$PWD/.dev venv=$PWD/.dev/venv workspace=$PWD/.dev/ws
source tools/packages.bash
source tools/install.bash
case ${1:-} in
  packages)
    mkdir -p "$state"
    install_debian_packages launch grade
    make_venv
    complete_venv grade
    apt-get clean
    rm -rf /var/lib/apt/lists/* "$state/wheels"
    ;;
  build) ./dev setup ;;
  *) die "usage: $0 packages | build" ;;
esac

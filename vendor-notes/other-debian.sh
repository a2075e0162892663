# Sourced by install-*.sh: packages of another Debian release, beside the system's own apt. Needs `say`, `fail` and `as_root`.

debian_keyring=/usr/share/keyrings/debian-archive-keyring.gpg

apt_updated=no
apt_update() { # once per run
    [ "$apt_updated" = no ] || return 0
    say 'refreshing the package lists'
    as_root apt-get -q update
    apt_updated=yes
}

debian_uri() { # the address this machine takes Debian's main archive from
    # shellcheck disable=SC2016 # apt expands $(REPO_URI)
    apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Origin: Debian' "Codename: $VERSION_CODENAME" | head -n 1
}

other_debian() { # DIR RELEASE : leaves DIR/apt/apt.conf, for apt-get -c, which knows the packages of that release and regards none as installed
    [ -r "$debian_keyring" ] || fail "$debian_keyring is missing: apt-get install debian-archive-keyring"
    local uri
    uri=$(debian_uri)
    if [ -z "$uri" ]; then
        apt_update
        uri=$(debian_uri)
    fi
    [ -n "$uri" ] || fail "apt's sources name no Debian archive for $VERSION_CODENAME"
    mkdir -p "$1/apt/lists/partial" "$1/apt/archives/partial"
    : >"$1/apt/status"
    echo "deb [signed-by=$debian_keyring] $uri $2 main" >"$1/apt/sources.list"
    # Read after the machine's own configuration, of which the proxy and credentials stay and the hooks go.
    cat >"$1/apt/apt.conf" <<END
Dir::State "$1/apt";
Dir::State::Status "$1/apt/status";
Dir::Cache "$1/apt";
Dir::Etc::SourceList "$1/apt/sources.list";
Dir::Etc::SourceParts "/dev/null";
Dir::Etc::Preferences "/dev/null";
Dir::Etc::PreferencesParts "/dev/null";
APT::Default-Release "$2";
APT::Sandbox::User "$(id -un)";
APT::Update::Error-Mode "any";
Acquire::Languages "none";
Acquire::IndexTargets::deb::DEP-11::DefaultEnabled "false";
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
END
    apt-get -q -c "$1/apt/apt.conf" update \
        || fail "the signature or the lists of Debian $2 could not be had; an old debian-archive-keyring may lack its keys"
}
